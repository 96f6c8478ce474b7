// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/chain.h"

#include "procedural/wind/bend.h"

#include <algorithm>

namespace marram {
namespace {

// e = clamp(calm + gusts) * the groom's own * (1 - shield * sheltered share) * response(speed)
void set_envelope(const ChainFrame& chain, double strength, Strands& strands) {
    const Wind& wind = *chain.wind;
    const float loss = wind.shielding ? float(wind.shielding->shield) : 0.0F;
    for (int k = 0; k < strands.cvs; ++k) {
        const double u = double(k) / double(strands.cvs - 1);
        const auto own = float(std::clamp((*chain.point_envelope)(u), 0.0, 1.0) * strength);
        for (int i = 0; i < strands.blocks; ++i) {
            const size_t at = size_t(i) * size_t(strands.cvs) + size_t(k);
            VFloat e = splat_float(own);
            if (loss > 0.0F) {
                const VFloat left = 1.0F - loss * strands.shield[at];
                e *= left > 0.0F ? left : VFloat{};
            }
            strands.envelope[at] = e;
        }
    }
}

} // namespace

ChainFrame make_chain_frame(const Wind& wind, const Ramp& point_envelope, const MarramFrame& frame,
                            const MarramMesh& skin, std::span<const float> radius_profile,
                            MarramBasis basis) {
    ChainFrame chain{&wind, &point_envelope, frame, &skin, radius_profile, basis, {}};
    chain.instants.resize(frame.time_count);
    for (uint32_t t = 0; t < frame.time_count; ++t) {
        ChainFrame::Instant& instant = chain.instants[t];
        if (wind.shielding || wind.collision) instant.colliders = colliders_at(frame, t);
        if (wind.shielding && wind.shielding->wake_heights)
            instant.obstacle_heights = obstacle_heights(instant.colliders);
    }
    return chain;
}

void run_chain(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch) {
    const Wind& wind = *chain.wind;
    const ChainFrame::Instant& instant = chain.instants[time];
    const double strength = chain.frame.stage == MARRAM_REST ? 0.0 : wind_envelope(wind);
    const bool bends = strength > 0.0 && wind.global_rotate > 0.0;
    if (wind.shielding && bends) {
        const StageTimer timer(scratch.clock.shield);
        shield(*wind.shielding, wind.direction, instant.colliders, instant.obstacle_heights, strands);
    } else {
        std::fill(strands.shield.begin(), strands.shield.end(), VFloat{});
    }
    {
        const StageTimer timer(scratch.clock.bend);
        set_envelope(chain, strength, strands);
        if (bends) {
            bend(wind, chain.frame.times[time], chain.frame.fps, strands);
        } else {
            std::copy(strands.rest.begin(), strands.rest.end(), strands.pose.begin());
            std::copy(strands.rest_normal.begin(), strands.rest_normal.end(), strands.pose_normal.begin());
        }
    }
    if (wind.collision && chain.frame.stage == MARRAM_FINAL) {
        const StageTimer timer(scratch.clock.collide);
        const CollideJob job{&*wind.collision, &instant.colliders,    chain.skin, chain.radius_profile,
                             chain.basis,      chain.frame.tolerance, nullptr};
        collide(job, strands, scratch.collide, scratch.counts);
    }
}

} // namespace marram
