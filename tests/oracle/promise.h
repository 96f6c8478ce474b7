// SPDX-License-Identifier: Apache-2.0
// Checks the guarantees of collision: a strand's polygon crosses no triangle, and its rendered curve
// penetrates none.
//
// The rendered curve is a uniform cubic B-spline or Catmull-Rom spline with one phantom CV at each end,
// 2 P_0 - P_1 and 2 P_{n-1} - P_{n-2}, so that span k, 0 <= t <= 1, belongs to segment k. B-spline: (1-t)^3/6,
// (3t^3-6t^2+4)/6, (-3t^3+3t^2+3t+1)/6, t^3/6. Catmull-Rom: (-t^3+2t^2-t)/2, (3t^3-5t^2+2)/2,
// (-3t^3+4t^2+t)/2, (t^3-t^2)/2. The polygon is free, so a point of the curve is behind the surface if the
// straight line to it from the polygon's point at the same parameter crosses a triangle; its distance from
// the surface is then negative. The penetration (dip) is the radius minus that distance: positive where the
// rendered curve enters the surface.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

// The number of segments of a strand that cross at least one triangle.
int crossed_segments(const std::vector<Vec3d>& cvs, const TriangleSet& set);

enum class Spline { b_spline, catmull_rom };
Vec3d spline_point(const std::vector<Vec3d>& cvs, Spline spline, size_t segment, double t);

// The deepest penetration on each segment, from `samples` + 1 points per segment; between samples it is
// deeper by at most half their distance on the curve. Values below -`reach` are returned as -reach. radius:
// per CV, linear between CVs.
std::vector<double> deepest_penetrations(const std::vector<Vec3d>& cvs, const std::vector<double>& radius,
                                         Spline spline, int samples, double reach, const TriangleSet& set);

} // namespace marram::oracle
