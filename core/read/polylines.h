// SPDX-License-Identifier: Apache-2.0
// Reads polylines from files: .obj, .ply, .usda.
//
// To add a format, declare its read_<format>_polylines() here and name its extension in load_polylines().
#pragma once

#include "core/math/problem.h"
#include "core/math/vec.h"

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct Polyline {
    std::vector<Vec3d> points;
    bool closed = false; // the last point is joined to the first
};

// The polylines of a file; its extension selects the format. Throws InputError if there are none, for invalid
// indices and numbers, and for coordinates beyond 1e8 m.
//   .obj   its l elements
//   .ply   ascii or binary. With an element "edge" (integers vertex1, vertex2): lines along the edges. An
//          open line begins at the end whose vertex is first in the file, a ring is closed, a fork is an
//          error, vertices without an edge are ignored. Else with an integer strand_id or curve_id per
//          vertex: the vertices of each id, in the file's order. Else all vertices in order.
//   .usda  its BasisCurves (usda_curves.h); cubics as usda_points_a_segment points on the curve per segment
// prims: of a .usda, as of find_usda_curves(). warnings: what is left out, without the file's name.
std::vector<Polyline> load_polylines(const std::string& file, std::span<const std::string> prims = {},
                                     std::vector<std::string>* warnings = nullptr);

inline constexpr int usda_points_a_segment = 8;

// Shared by the readers.
// Throws InputError if prims are chosen of a file that is no .usda.
void check_prims(const std::string& file, const std::string& extension, std::span<const std::string> prims);
inline constexpr double max_curve_coordinate = 1e8; // metres, as in scenes
std::vector<Polyline> read_ply_polylines(const std::string& file, std::string_view bytes);
std::vector<Polyline> read_usda_polylines(const std::string& file, std::string_view bytes,
                                          std::span<const std::string> prims = {},
                                          std::vector<std::string>* warnings = nullptr);

} // namespace marram
