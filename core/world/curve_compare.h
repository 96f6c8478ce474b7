// SPDX-License-Identifier: Apache-2.0
// Compares two builds of the same strands.
#pragma once

#include "core/geometry/view.h"
#include "core/geometry/world.h"

#include <limits>

namespace marram {

struct CurveDistance {
    // Statistics over strands of each strand's largest distance. most: the 99th percentile.
    double rms = 0.0, most = 0.0, worst = 0.0;
    uint64_t strands = 0; // number compared
    double beyond = 0.0;  // fraction of strands that are farther apart than a limit
};

// Distance between CVs at the first motion sample, as a fraction of the reference strand's length. If CV
// counts differ, each CV of the strand with more is compared with the other's CV polygon at the same fraction
// of its CVs. Throws std::invalid_argument if the numbers of strands differ. Cost: 5 ns per CV and processor.
CurveDistance relative_cv_distance(const World& mine, const World& reference);

// The same in metres. limit: for CurveDistance::beyond.
CurveDistance cv_distance(const World& mine, const World& reference,
                          double limit = std::numeric_limits<double>::infinity());

// Distance in metres, enlarged by the view, between CVs that move linearly between motion samples; at every
// motion sample of the reference. limit: for CurveDistance::beyond.
CurveDistance motion_cv_distance(const World& mine, const World& reference, const View& view = {},
                                 double limit = std::numeric_limits<double>::infinity());

// Number of strands with a segment that crosses a mesh, at the first motion sample. Traces a ray along each
// segment of the CV polygon; the first thousandth of the root segment is skipped. Cost: 0.2 us per segment
// and processor.
uint64_t count_crossing_strands(const World& world);

} // namespace marram
