// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/chain.h"

#include "procedural/wind/bend.h"

#include <algorithm>

namespace marram {

void run_chain(const Wind& wind, const Ramp& point_envelope, double frame, double fps, MarramStage stage,
               Strands& strands, StageClock& clock) {
    const StageTimer timer(clock.bend);
    const double strength = stage == MARRAM_REST ? 0.0 : wind_envelope(wind);

    // The envelope before gusts and shielding, which scale it here once they exist.
    for (int k = 0; k < strands.cvs; ++k) {
        const double u = double(k) / double(strands.cvs - 1);
        const auto e = float(std::clamp(point_envelope(u), 0.0, 1.0) * strength);
        for (int i = 0; i < strands.blocks; ++i)
            strands.envelope[size_t(i) * size_t(strands.cvs) + size_t(k)] = splat_float(e);
    }

    if (strength > 0.0 && wind.global_rotate > 0.0) {
        bend(wind, frame, fps, strands);
    } else {
        std::copy(strands.rest.begin(), strands.rest.end(), strands.pose.begin());
        std::copy(strands.rest_normal.begin(), strands.rest_normal.end(), strands.pose_normal.begin());
    }

    // Jiggle and collision follow here: pose -> pose.
}

} // namespace marram
