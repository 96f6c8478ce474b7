// SPDX-License-Identifier: Apache-2.0
// The point of a segment or a triangle that is nearest to another point. Error: a few roundings of the longest
// edge.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <array>
#include <limits>

namespace marram {

// The closest point to q on the segment from a to b; if it has no length, a.
inline Vec3d nearest_point(const Vec3d& a, const Vec3d& b, const Vec3d& q) {
    const Vec3d e = b - a;
    const double ee = e.squaredNorm();
    return ee > 0.0 ? Vec3d(a + e * std::clamp((q - a).dot(e) / ee, 0.0, 1.0)) : a;
}

// The closest point to q on triangle p: C. Ericson, "Real-Time Collision Detection", 5.1.5, by Voronoi
// regions. A triangle without area counts as its edges.
inline Vec3d nearest_point(const std::array<Vec3d, 3>& p, const Vec3d& q) {
    const Vec3d ab = p[1] - p[0], ac = p[2] - p[0], n = ab.cross(ac);
    const double nn = n.squaredNorm();
    const double longest = std::max({ab.squaredNorm(), ac.squaredNorm(), (p[2] - p[1]).squaredNorm()});
    constexpr double rounding = 1e-14;
    if (nn > rounding * rounding * longest * longest) {
        const Vec3d aq = q - p[0];
        const double v = aq.cross(ac).dot(n), w = ab.cross(aq).dot(n); // barycentric coordinates times nn
        if (v >= 0.0 && w >= 0.0 && v + w <= nn) return q - n * (aq.dot(n) / nn);
    }
    Vec3d best = p[0];
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < 3; ++i) {
        const Vec3d c = nearest_point(p[i], p[(i + 1) % 3], q);
        const double d = (c - q).squaredNorm();
        if (d >= least) continue;
        least = d;
        best = c;
    }
    return best;
}

} // namespace marram
