// SPDX-License-Identifier: Apache-2.0
// How far the same strands lie apart when they were made in two ways.
#pragma once

#include "core/geometry/view.h"
#include "core/geometry/world.h"

#include <limits>

namespace marram {

struct CurveGap {
    // Over strands, of each strand's largest distance; most: what 99 in 100 stay below.
    double rms = 0.0, most = 0.0, worst = 0.0;
    uint64_t strands = 0; // that were compared
    double beyond = 0.0;  // share of the strands that are farther apart than a limit
};

// CVs at the first motion sample, as shares of the strand's length. Where the numbers of CVs differ, each CV of the strand that has
// more against the point of the other's polygon at the same share of its CVs. Throws std::invalid_argument where the strands are not the same
// in number. Cost: 5 ns a CV and processor.
CurveGap gap_at_rest(const World& mine, const World& reference);

// The same in metres.
CurveGap gap_in_space(const World& mine, const World& reference);

// CVs as they move along straight lines between motion samples, in metres, enlarged by the view, at every sample of the reference.
CurveGap gap_in_motion(const World& mine, const World& reference, const View& view = {},
                       double limit = std::numeric_limits<double>::infinity());

// Strands that have a segment which a mesh crosses, at the first motion sample, by a ray along each segment of the
// polygon; of the first segment the thousandth next to the root is left out. Cost: 0.2 us a segment and processor.
uint64_t strands_in_meshes(const World& world);

} // namespace marram
