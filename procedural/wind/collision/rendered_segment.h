// SPDX-License-Identifier: Apache-2.0
// The rendered cubic of a strand's segment: its offset from the polygon of CVs, and whether it penetrates a
// collider.
//
// With D_k = P_{k-1} - 2 P_k + P_{k+1} (0 at both ends, by the phantom CVs) segment k of a curve is
//
//     uniform cubic B-spline  P_k + t (P_{k+1} - P_k) + ((1-t)^3 D_k + t^3 D_{k+1}) / 6
//     Catmull-Rom             P_k + t (P_{k+1} - P_k) - (t (1-t)^2 D_k + t^2 (1-t) D_{k+1}) / 2
//
// so its offset from the polygon is at most max |D| / 6 or / 8. If offset + radius <= free distance +
// tolerance, it cannot penetrate too far. Otherwise it is tested point by point. A point counts as outside
// the colliders unless the straight line from the polygon to it crosses a triangle.
#pragma once

#include "procedural/wind/collision/turn.h"

#include <algorithm>

namespace marram {

struct RenderedSegment {
    Vec3d start, end, d0, d1; // the segment, and D at its two ends
    double r0, r1;            // radii there
    bool bspline;

    Vec3d on_polygon(double t) const { return (1.0 - t) * start + t * end; }
    double radius(double t) const { return (1.0 - t) * r0 + t * r1; }
    Vec3d offset(double t) const {
        const double s = 1.0 - t;
        return bspline ? Vec3d((s * s * s * d0 + t * t * t * d1) / 6.0)
                       : Vec3d(-0.5 * (t * s * s * d0 + t * t * s * d1));
    }
    // offset(t) for t in [begin, end] is x d0 + y d1, with x and y between 0 and these values.
    Vec2d offset_bounds(double begin, double end) const {
        const double s = 1.0 - begin;
        if (bspline) return {s * s * s / 6.0, end * end * end / 6.0};
        // t (1-t)^2 has its maximum at 1/3, t^2 (1-t) at 2/3.
        const double t = std::clamp(1.0 / 3.0, begin, end), u = std::clamp(2.0 / 3.0, begin, end);
        return {-0.5 * t * (1.0 - t) * (1.0 - t), -0.5 * u * u * (1.0 - u)};
    }
    double max_offset() const { return std::max(d0.norm(), d1.norm()) / (bspline ? 6.0 : 8.0); }
};

// True: the rendered curve of a segment, whose polygon has a distance of at least `free_distance` from every
// collider, penetrates by more than the tolerance.
bool penetrates_collider(const Colliders& colliders, const RenderedSegment& segment, double free_distance,
                         double tolerance, TurnScratch& scratch);

} // namespace marram
