// SPDX-License-Identifier: Apache-2.0
// Queries between one triangle and points or segments: nearest points, distances, crossings. Degenerate
// triangles (needles, doubled vertices, single points) and segments of no length are allowed everywhere.
//
// Nearest points are the best of a few candidates: two such convex sets are nearest at a vertex and
// something, at two edges, or in the interior of a face. Each candidate lies in the triangle and on the
// segment by construction, so rounding and degeneracy can only make a distance too great, and only by
// rounding.
#pragma once

#include "core/math/vec.h"

namespace marram::oracle {

struct Triangle {
    Vec3d a, b, c;
};

// (b - a) x (c - a): its length is twice the area; 0 for a degenerate triangle.
Vec3d area_normal(const Triangle& t);

Vec3d nearest_point_on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b);
Vec3d nearest_point_on_triangle(const Vec3d& p, const Triangle& t);

struct Closest {
    double distance = std::numeric_limits<double>::infinity();
    Vec3d on_segment = Vec3d::Zero(), on_triangle = Vec3d::Zero();
};
// Nearest points of the segment pq and the triangle; distance 0 exactly when they cross (by `crosses` below).
Closest closest(const Vec3d& p, const Vec3d& q, const Triangle& t);

// Whether the closed segment pq and the closed triangle have a point in common, decided exactly
// (predicates.h). A degenerate triangle has no surface to cross: false.
bool crosses(const Vec3d& p, const Vec3d& q, const Triangle& t);

struct Crossing {
    bool crosses = false;
    double parameter = 0.0; // position along pq, 0 to 1; approximate for a segment in the triangle's plane
    // The smallest movement that could change `crosses`: for a crossing the least of the ends' heights over
    // the plane and of the line's distances from the three edges; otherwise the distance.
    double margin = 0.0;
};
Crossing crossing(const Vec3d& p, const Vec3d& q, const Triangle& t);

} // namespace marram::oracle
