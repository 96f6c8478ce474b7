// SPDX-License-Identifier: Apache-2.0
// Curves that a person draws and that the wind follows, in plan: x and z.
//
// Each metre of curve has the weight w = 1 / (d^2 + cell^2) at a point at the distance d; the undisturbed
// wind has the weight pi / reach. Where the wind goes is their weighted mean: of angles
// (terrain/wind_field.cpp) or of directions (wind/field/guide_map.cpp). The integral of w over a long
// straight curve is pi / q with q^2 = d^2 + cell^2, so reach is the distance at which curve and wind weigh
// the same, and on the curve its share is reach / (reach + cell).
//
// The integrals are exact for each segment: on a line at the distance h, from s0 to s1 along it,
//
//   integral of w = (atan(s1 / q) - atan(s0 / q)) / q,    q^2 = h^2 + cell^2
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <span>
#include <vector>

namespace marram {

// A drawn curve from the scene.
struct DrawnCurve {
    std::vector<Vec3d> points;
    bool closed = false;
};

// The curves' CVs at the first motion sample.
std::vector<DrawnCurve> drawn_curves(const MarramCurves& curves);

struct GuideSegment {
    Vec2d a, b; // x and z
    double length = 0.0;
};

// The curves as segments. Points closer together than two cells, or than a tenth of their distance from the
// box, are skipped, but the last of a curve: the wind has no finer features there.
std::vector<GuideSegment> guide_segments(std::span<const DrawnCurve> curves, double cell,
                                         const Eigen::AlignedBox2d& box);

// The integral of w over a segment, 1/m.
double guide_weight(const Vec2d& p, const GuideSegment& segment, double cell);

} // namespace marram
