// SPDX-License-Identifier: Apache-2.0
// The lines (l) of a Wavefront OBJ, for polylines (polylines.h) and strands (strand_file.h).
#pragma once

#include "core/math/vec.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct ObjLines {
    std::vector<Vec3d> vertices;  // of the file, to the nearest double
    std::vector<uint32_t> counts; // points of each line
    std::vector<uint32_t> order;  // vertices of all lines in sequence
};

// Everything but v and l is ignored. Throws InputError, with the place where it is known, for numbers and
// indices that are none or out of range, for coordinates beyond 1e8 m, and without lines.
ObjLines read_obj_lines(const std::string& file, std::string_view bytes);

} // namespace marram
