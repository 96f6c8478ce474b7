// SPDX-License-Identifier: Apache-2.0
// What the readers of files of meshes and of curves share; nobody else needs it.
//
// To add a format of meshes, write its read_<format>() here and in a file of its own, and name its extension in
// load_mesh().
#pragma once

#include "core/geometry/mesh.h"
#include "core/math/problem.h"

#include <string>
#include <string_view>

namespace marram {

inline constexpr double greatest_coordinate = 1e18; // Embree drops a little above this
inline constexpr uint32_t greatest_polygon = 10000; // corners; cutting a concave one takes their square
inline constexpr uint64_t greatest_count =
    0xffffffffu - 1; // of vertices, of triangles; also keeps ~0u free as "none"

// Both take a whole file and return a mesh whose normals, where there are any, need not be unit yet; a zero
// stands for one that is missing. They may overwrite `bytes`.
Mesh read_obj(const std::string& path, std::string& bytes);
Mesh read_ply(const std::string& path, std::string& bytes);

// A whole file. kinds: ".obj or .ply". Throws InputError where there is none that can be read.
std::string read_bytes(const std::string& path, const char* kinds);
// ".obj" of "a.OBJ".
std::string extension_of(const std::string& path);

// The line and column of bytes[offset]. Lines end in \n, or in \r where there is no \n.
Place place_of(const std::string& path, std::string_view bytes, size_t offset);

enum class NumberFault { none, not_a_number, not_finite };
// Reads all of `token` as a number; one too small for a double is 0.
NumberFault parse_number(std::string_view token, double& value);

// Cuts a polygon of at least 3 corners into corners.size() - 2 triangles with the same winding. Convex
// polygons become fans; others lose one ear after another (Meisters 1975) in the plane that they face most.
void append_polygon(std::span<const Vec3f> positions, std::span<const uint32_t> corners,
                    std::vector<std::array<uint32_t, 3>>& triangles);

// Room for the 16 bytes that Embree may read past the end of a shared buffer.
template <typename Element>
void reserve_spare_bytes(std::vector<Element>& buffer) {
    buffer.reserve(buffer.size() + (16 + sizeof(Element) - 1) / sizeof(Element));
}

} // namespace marram
