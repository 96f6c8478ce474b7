// SPDX-License-Identifier: Apache-2.0
// Polylines from files: .obj, .ply, .usda.
//
// To add a format, write its read_<format>_polylines() here and name its extension in load_polylines().
#pragma once

#include "core/math/problem.h"
#include "core/math/vec.h"

#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct Polyline {
    std::vector<Vec3d> points;
    bool closed = false; // the last point is joined to the first
};

// The polylines of a file, by its extension. Throws InputError where there are none, for indices and numbers that are not usable, and
// for coordinates beyond 1e8 m.
//   .obj   its l elements
//   .ply   ascii or binary. With an element "edge" (integers vertex1, vertex2): lines of vertices that edges join; an open one begins at
//          the end whose vertex stands first in the file, a ring is closed, a fork is refused, vertices without an edge are passed over.
//          Else with an integer strand_id or curve_id a vertex: the vertices of one id, in the file's order. Else all vertices in order.
//   .usda  its BasisCurves (usda_curves.h); cubic ones as points on the curve, usda_points_a_segment for each cubic
std::vector<Polyline> load_polylines(const std::string& file);

inline constexpr int usda_points_a_segment = 8;

// What the readers share.
inline constexpr double greatest_curve_coordinate = 1e8; // metres, as scenes may have
std::vector<Polyline> read_ply_polylines(const std::string& file, std::string_view bytes);
std::vector<Polyline> read_usda_polylines(const std::string& file, std::string_view bytes);

} // namespace marram
