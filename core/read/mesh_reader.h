// SPDX-License-Identifier: Apache-2.0
// Shared by the readers of files: bytes, polygons, and what reads each mesh format.
//
// To add a mesh format, declare its read_<format>() here, implement it in its own file, and call it in
// load_mesh() for its extension (core/math/file_types.h).
#pragma once

#include "core/geometry/mesh.h"
#include "core/math/problem.h"
#include "core/math/text.h"

#include <string>
#include <string_view>
#include <vector>

namespace marram {

inline constexpr uint32_t max_polygon = 10000; // corners; concave ones take quadratic time

// Each parses a whole file. The mesh's normals, if any, need not be unit yet; a zero stands for a missing
// one. They may overwrite `bytes`. warnings: as in MeshLoading.
Mesh read_obj(const std::string& path, std::string& bytes, std::vector<Problem>* warnings);
Mesh read_ply(const std::string& path, std::string& bytes);
Mesh read_vdb(const std::string& path, std::string& bytes);

// Reads a whole file. kinds, for messages: ".obj or .ply". Throws InputError if it cannot be read.
std::string read_bytes(const std::string& path, const std::string& kinds);
// The same without a byte order mark (math/text.h), for formats that are text or begin as text.
std::string read_text(const std::string& path, const std::string& kinds);

// Triangulates a polygon of at least 3 corners: corners.size() - 2 triangles with the same winding. Convex
// polygons become fans; others are triangulated by ear clipping (Meisters 1975) in the coordinate plane that
// they face most.
void append_polygon(std::span<const Vec3f> positions, std::span<const uint32_t> corners,
                    std::vector<std::array<uint32_t, 3>>& triangles);

} // namespace marram
