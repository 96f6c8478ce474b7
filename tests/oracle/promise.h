// SPDX-License-Identifier: Apache-2.0
// Does a solved strand keep its promise? Its polygon crosses no triangle, and its drawn curve dips into none.
//
// The drawn curve is a uniform cubic B-spline or Catmull-Rom spline with one phantom CV at each end, 2 P_0 -
// P_1 and 2 P_{n-1} - P_{n-2}, so that span k, 0 <= t <= 1, belongs to segment k. B-spline: (1-t)^3/6,
// (3t^3-6t^2+4)/6, (-3t^3+3t^2+3t+1)/6, t^3/6. Catmull-Rom: (-t^3+2t^2-t)/2, (3t^3-5t^2+2)/2,
// (-3t^3+4t^2+t)/2, (t^3-t^2)/2. The polygon is free, so a point of the curve is on the wrong side of the
// surface where the straight line to it from the polygon's point at the same parameter crosses a triangle;
// its distance from the surface counts negative there. The dip is the radius minus that distance: positive
// where the drawn curve reaches into the surface.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

// How many segments of a strand cross at least one triangle.
int crossed_segments(const std::vector<Vec3d>& cvs, const TriangleSet& set);

enum class Spline { b_spline, catmull_rom };
Vec3d drawn_point(const std::vector<Vec3d>& cvs, Spline spline, size_t segment, double t);

// The deepest dip on each segment, `samples` + 1 points a segment; the dip between samples is greater by at
// most half their distance on the curve. Dips below -`reach` are given as -reach. radius: of every CV, linear
// between them.
std::vector<double> deepest_dips(const std::vector<Vec3d>& cvs, const std::vector<double>& radius,
                                 Spline spline, int samples, double reach, const TriangleSet& set);

} // namespace marram::oracle
