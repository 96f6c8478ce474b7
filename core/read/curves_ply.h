// SPDX-License-Identifier: Apache-2.0
// Curves in PLY files, for polylines (polylines.h) and strands (strand_file.h).
#pragma once

#include "core/math/vec.h"
#include "core/read/ply_file.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// A scalar property of all entries of an element.
struct PlyColumn {
    std::string name;
    PlyScalar type = PlyScalar::float32;
    std::vector<float> values;
    uint64_t folded = 0; // integers that a float would round (integer_to_float)
};

struct PlyCurvesContent {
    std::vector<Vec3d> points;          // of the file's vertices
    std::vector<PlyColumn> of_vertices; // their other properties
    // Curve c connects the vertices order[first[c]] ... order[first[c + 1] - 1], and back to the first if it
    // is closed.
    std::vector<uint32_t> order;
    std::vector<uint64_t> first{0};
    std::vector<char> closed;
    std::vector<int64_t> ids; // of curves, if vertices have curve ids
    bool is_cloud = false;    // neither edges nor ids say which points belong together
    // The element "strand" or "curve".
    bool has_entries = false;
    uint64_t entries = 0;
    std::vector<int64_t> entry_ids; // empty, or one per entry
    std::vector<PlyColumn> of_entries;
};

// with_columns: also reads of_vertices and the element "strand" or "curve". points_per_curve: of a cloud,
// whose points follow each other curve by curve; 0: they are one curve. Throws InputError if it does not fit.
PlyCurvesContent read_ply_curves(const std::string& file, std::string_view bytes, bool with_columns,
                                 uint32_t points_per_curve = 0);

} // namespace marram
