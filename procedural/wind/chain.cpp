// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/chain.h"

#include "procedural/abi/ramp_table.h"
#include "procedural/wind/bend.h"
#include "procedural/wind/keyed_wind.h"

#include <algorithm>
#include <cstring>
#include <optional>

namespace marram {

std::span<const StageClock::Stage> StageClock::stages() {
    static constexpr Stage list[] = {
        {&StageClock::expand, "thread_seconds.expand", "laying out strands and writing their CVs"},
        {&StageClock::gusts, "thread_seconds.gusts", "gusts"},
        {&StageClock::shield, "thread_seconds.shield", "shielding"},
        {&StageClock::bend, "thread_seconds.bend", "bend"},
        {&StageClock::jiggle, "thread_seconds.jiggle", "jiggle"},
        {&StageClock::collide, "thread_seconds.collide", "collision"},
    };
    return list;
}

size_t ChainFrame::gust_bytes() const {
    size_t sum = 0;
    for (const Instant& instant : instants) sum += instant.wind.gusts.bytes();
    if (past_wind) sum += past_wind->bytes();
    return sum;
}

ChainFrame make_chain_frame(const ChainInput& input) {
    const Wind& wind = input.wind;
    const MarramFrame& frame = input.frame;
    ChainFrame chain{&wind, &input.point_envelope, frame, input.skin, input.radius_profile, input.basis,
                     {},    input.window,          {}};
    const bool bends = frame.stage != MARRAM_REST && wind_bends(wind);
    if (bends) chain.ground = input.ground;
    if (bends) chain.canopy = input.canopy;
    chain.blade = input.blade;
    chain.instants.resize(frame.time_count);
    for (uint32_t t = 0; t < frame.time_count; ++t) {
        ChainFrame::Instant& instant = chain.instants[t];
        if (wind.shielding || wind.collision) instant.colliders = colliders_at(frame, t);
        if (wind.shielding && wind.shielding->wake_heights)
            instant.obstacle_heights = obstacle_heights(instant.colliders);
        instant.wind =
            wind_with_gusts(wind, frame.times[t], frame.fps, bends, input.rest, chain.ground.get());
    }
    const bool asks_tree =
        wind.collision && (wind.collision->solver == Solver::exact || wind.collision->offset_scale);
    if (asks_tree && frame.stage == MARRAM_FINAL) {
        std::vector<Colliders*> colliders;
        for (ChainFrame::Instant& instant : chain.instants) colliders.push_back(&instant.colliders);
        ColliderTrees fresh;
        (input.trees ? *input.trees : fresh).build_or_reuse(frame, input.query_bounds, colliders);
    }
    if ((wind.gusts || wind.keys || !wind.fields.empty()) && bends && !chain.window.empty())
        chain.past_wind = std::make_shared<PastWind>(
            wind, PastWind::Key{frame.fps, wind.jiggle->step, input.rest, chain.ground}, chain.window.first,
            chain.window.last, input.past_wind);
    // Now, since patches ask for the past from within parallel loops.
    for (int64_t s = chain.window.first; chain.past_wind && chain.ground && s <= chain.window.last; ++s)
        ground_at(wind, wind.jiggle->frame_of(s), chain.ground.get());
    return chain;
}

namespace {

MARRAM_INLINE void scale_by_share(Strands& strands) {
    for (int i = 0; i < strands.blocks; ++i)
        for (int k = 0; k < strands.cvs; ++k)
            strands.envelope[size_t(i) * size_t(strands.cvs) + size_t(k)] *= strands.wind_share[size_t(i)];
}

MARRAM_INLINE void scale_by_response(Strands& strands) {
    for (int i = 0; i < strands.blocks; ++i)
        for (int k = 0; k < strands.cvs; ++k)
            strands.envelope[size_t(i) * size_t(strands.cvs) + size_t(k)] *=
                strands.wind_response[strands.wind_at(i, k)];
}

// e = clamp(calm + gusts) * groom's envelope * (1 - shield * sheltered fraction) * response(speed)
// Over ground, the stronger shelter counts, of rays or of the ground; speed-up counts in either case.
MARRAM_HOT void set_envelope(const Wind& wind, const float* own, Strands& strands) {
    const VFloat calm = splat_float(float(wind.calm)), one = splat_float(1.0F), zero{};
    const bool once = !strands.wind_unsheltered.empty();
    const VFloat loss = splat_float(wind.shielding ? float(wind.shielding->shield) : 0.0F);
    for (int i = 0; i < strands.blocks; ++i)
        for (int k = 0; k < strands.cvs; ++k) {
            const size_t at = size_t(i) * size_t(strands.cvs) + size_t(k);
            VFloat e = calm + strands.gust[at];
            e = e < zero ? zero : e > one ? one : e;
            VFloat left = one - loss * strands.shield[at];
            left = left > zero ? left : zero;
            if (once) {
                const size_t local = strands.wind_at(i, k);
                left = vmin(left * strands.wind_unsheltered[local], strands.wind_response[local]);
            }
            strands.envelope[at] = e * left * own[k];
        }
    if (strands.has_wind_share) scale_by_share(strands);
}

// The canopy slows the wind: the envelope times response(speed * canopy) / response(speed).
MARRAM_HOT void scale_by_canopy(const Wind& wind, Strands& strands) {
    const bool local = !strands.wind_speed.empty();
    const VDouble mean = splat(wind.speed);
    for (int i = 0; i < strands.blocks; ++i) {
        VDouble speed, per_free;
        for (int k = 0; k < strands.cvs; ++k) {
            if (k == 0 || strands.wind_at_cvs) {
                speed = local ? to_double(strands.wind_speed[strands.wind_at(i, k)]) : mean;
                const VDouble free = vmin(vmax(evaluate(wind.response, speed), VDouble{}), 1.0);
                const VLong blows = free > 0.0;
                per_free = select(blows, 1.0 / select(blows, free, 1.0), 0.0);
            }
            const size_t at = size_t(i) * size_t(strands.cvs) + size_t(k);
            const VDouble slowed = evaluate(wind.response, speed * to_double(strands.canopy[at]));
            strands.envelope[at] *= to_float(vmin(vmax(slowed, VDouble{}), 1.0) * per_free);
        }
    }
}

// The groom's envelope for strands with irregular segments: u differs from strand to strand.
MARRAM_HOT void scale_envelope(const Ramp& own, Strands& strands) {
    for (size_t i = 0; i < strands.envelope.size(); ++i) {
        const VDouble share = vmin(vmax(evaluate(own, strands.u[i]), VDouble{}), 1.0);
        strands.envelope[i] *= to_float(share);
    }
}

// strands.rest -> pose, from the wind at `frame` and the shelter in strands.shield.
void bend_at(const ChainFrame& chain, const WindAt& at, double frame, Strands& strands, StageClock& clock,
             uint64_t& unsolved) {
    const Wind& wind = *at.wind;
    {
        const StageTimer timer(clock.gusts);
        std::fill(strands.gust.begin(), strands.gust.end(), VFloat{});
        if (!at.gusts.levels.empty()) add_gusts(at.gusts, strands);
    }
    const StageTimer timer(clock.bend);
    const bool rests = chain.frame.stage == MARRAM_REST;
    if ((at.fields.empty() && !at.ground.air) || rests) {
        strands.wind_direction.clear();
        strands.wind_response.clear();
        strands.wind_unsheltered.clear();
        strands.wind_speed.clear();
        strands.wind_at_cvs = false;
    } else {
        local_wind({wind.direction, wind.speed, wind.response, at.fields, at.ground,
                    wind.over ? wind.over->speed : SpeedHeight{}, wind.shielding.has_value(),
                    wind.fields_at_cvs && !at.fields.empty()},
                   strands);
    }
    const bool local = !strands.wind_response.empty();
    const double response = rests ? 0.0 : local ? 1.0 : wind_response(wind);
    const Ramp& envelope = wind.point_envelope ? *wind.point_envelope : *chain.point_envelope;
    std::vector<float> own(size_t(strands.cvs), float(response));
    for (int k = 0; k < strands.cvs && !strands.irregular; ++k) {
        const double u = double(k) / double(strands.cvs - 1);
        own[size_t(k)] = float(std::clamp(envelope(u), 0.0, 1.0) * response);
    }
    set_envelope(wind, own.data(), strands);
    if (strands.irregular) scale_envelope(envelope, strands);
    if (local && strands.wind_unsheltered.empty()) scale_by_response(strands);
    if (chain.canopy && response > 0.0) {
        const bool turns = chain.wind->keys && chain.wind->keys->air.has_direction_keys();
        if (strands.canopy.empty() || turns) chain.canopy->attenuate(wind.direction, strands);
        scale_by_canopy(wind, strands);
    }
    const bool sags = chain.blade && chain.blade->sags && !rests;
    if ((response > 0.0 && wind_bends(wind)) || sags) {
        if (chain.blade)
            unsolved += bend_blades(wind, *chain.blade, frame, chain.frame.fps, strands);
        else
            bend(wind, frame, chain.frame.fps, strands);
    } else {
        std::copy(strands.rest.begin(), strands.rest.end(), strands.pose.begin());
        std::copy(strands.rest_normal.begin(), strands.rest_normal.end(), strands.pose_normal.begin());
    }
}

void shelter(const ChainFrame& chain, uint32_t time, Strands& strands, StageClock& clock) {
    const ChainFrame::Instant& instant = chain.instants[time];
    const Wind& wind = *instant.wind.wind;
    const StageTimer timer(clock.shield);
    if (wind.shielding && chain.frame.stage != MARRAM_REST && wind_bends(wind))
        shield(*wind.shielding, wind.direction, instant.colliders, instant.obstacle_heights, strands);
    else
        std::fill(strands.shield.begin(), strands.shield.end(), VFloat{});
}

bool same_bits(const WideVector<VFloat>& a, const WideVector<VFloat>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(VFloat)) == 0;
}

} // namespace

void jiggle_patch(const ChainFrame& chain, const RestStrandSource& rest_strands, Strands& strands,
                  ChainScratch& scratch, uint32_t phase, JiggleState* kept) {
    const std::span times(chain.frame.times, chain.frame.time_count);
    const Wind& wind = *chain.wind;
    const Jiggle& jiggle = *wind.jiggle;
    scratch.jiggled.resize(times.size());
    rest_strands.at_time(0, strands);
    shelter(chain, 0, strands, scratch.clock);
    Strands& past = scratch.past;
    past.has_wind_share = strands.has_wind_share;
    past.irregular = strands.irregular;
    past.resize(strands.count, strands.cvs, strands.oriented);
    std::copy(strands.shield.begin(), strands.shield.end(), past.shield.begin());
    uint64_t unsolved_before = 0; // not reported
    StageClock inner;             // not reported: the past bends count as the cost of jiggle
    const StageTimer timer(scratch.clock.jiggle);
    JiggleState* state = kept ? kept : &scratch.state;
    if (!kept || (wind.shielding && !same_bits(state->shield, strands.shield))) {
        state->forget();
        if (kept && wind.shielding) state->shield = strands.shield;
    }
    // The springs are the same in every frame, though the segments of a deforming strand are not.
    if (strands.irregular) rest_strands.at_bind(past);
    scratch.filter.begin(jiggle, chain.window, chain.frame.fps, strands.cvs, strands.blocks, past.u);
    WindAt same_always;
    same_always.wind = &wind;
    same_always.ground = chain.instants[0].wind.ground;
    std::optional<int64_t> laid_out; // the past sample whose rest strands `past` holds
    const auto bent = [&](int64_t past_sample, WideVector<Wide3f>& pose) {
        if (!rest_strands.moved) {
            if (!laid_out) past.copy_rest(strands);
        } else if (!laid_out || !rest_strands.same_at || !rest_strands.same_at(*laid_out, past_sample)) {
            rest_strands.at_past_sample(past_sample, past);
            past.canopy.clear();
        }
        laid_out = past_sample;
        bend_at(chain, chain.past_wind ? chain.past_wind->at(past_sample) : same_always,
                jiggle.frame_of(past_sample), past, inner, unsolved_before);
        std::swap(pose, past.pose);
    };
    for (size_t i = 0; i < times.size(); ++i) {
        if (chain.window.start && times[i] < jiggle.frame_of(*chain.window.start)) {
            scratch.jiggled[i].clear();
            continue;
        }
        // What is kept is the state at the first motion sample: the next frame may begin before the last one.
        if (i > 0 && state == kept && state->sample != jiggle.sample_before(times[i])) {
            scratch.later = *kept;
            state = &scratch.later;
        }
        if (i > 0 && rest_strands.moves) rest_strands.at_time(uint32_t(i), strands);
        scratch.filter.advance(*state, phase, times[i], bent);
        scratch.filter.emit(*state, times[i], strands, bent, scratch.jiggled[i]);
    }
}

void run_chain(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch) {
    const ChainFrame::Instant& instant = chain.instants[time];
    shelter(chain, time, strands, scratch.clock);
    strands.canopy.clear();
    bend_at(chain, instant.wind, chain.frame.times[time], strands, scratch.clock, scratch.unsolved_blades);
    if (chain.frame.stage != MARRAM_FINAL) return;
    if (chain.window.count() > 0 && !scratch.jiggled[time].empty()) {
        const StageTimer timer(scratch.clock.jiggle);
        const WideVector<Wide3f>& jiggled = scratch.jiggled[time];
        if (strands.oriented) jiggle_normals(strands, jiggled, strands.pose_normal);
        std::copy(jiggled.begin(), jiggled.end(), strands.pose.begin());
    }
    collide_pose(chain, time, strands, scratch);
}

void collide_pose(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch) {
    const Wind& wind = *chain.instants[time].wind.wind;
    if (!wind.collision || chain.frame.stage != MARRAM_FINAL) return;
    const StageTimer timer(scratch.clock.collide);
    const CollideJob job{&*wind.collision,
                         &chain.instants[time].colliders,
                         strands.instance ? strands.instance : chain.skin,
                         chain.radius_profile,
                         chain.basis,
                         chain.frame.tolerance};
    collide(job, strands, scratch.collide, scratch.counts);
}

} // namespace marram
