// SPDX-License-Identifier: Apache-2.0
// Triangle meshes, read from files (core/read/mesh_file.h) or built in, before they are passed to Embree.
#pragma once

#include "core/math/vec.h"

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Invariants after loading: every index < positions.size(); every number is finite; normals and uvs are empty
// or one per vertex; all vectors have spare capacity for the 16 bytes that Embree may read past their end.
struct Mesh {
    std::vector<Vec3f> positions;                   // object space
    std::vector<Vec3f> normals;                     // unit; empty: facetted
    std::vector<Vec2f> uvs;                         // empty if there are none
    std::vector<std::array<uint32_t, 3>> triangles; // anticlockwise seen from outside
};

inline constexpr uint64_t max_count =
    0xffffffffu - 1; // of vertices, of triangles; also keeps ~0u free as "none"

// Unit vertex normals: the mean of the triangles' normals weighted by their angle there (Thürmer and Wüthrich
// 1998), over all vertices that share the position, so that uv seams stay smooth. Triangles thinner than the
// rounding of their coordinates are ignored. If the sum vanishes (two sheets back to back), the vertex uses
// the sum of its own triangles, else the normal of one of them; a vertex without any triangle gets +y.
// Bit-identical at any thread count. Every index must be < positions.size(). Cost: 0.2 s for a million
// triangles on one core.
std::vector<Vec3f> vertex_normals(std::span<const Vec3f> positions,
                                  std::span<const std::array<uint32_t, 3>> triangles);

// For each vertex, the first one with the same position.
std::vector<uint32_t> weld(std::span<const Vec3f> positions);

// ---- Built-in meshes
//
// Centred on the origin, with uvs in 0 ... 1. They throw InputError for sizes that are not finite and
// positive and for counts below 1 or beyond 32 bits.

// size.x() by size.y() metres in the xz plane, facing up; divisions² squares. u runs along x, v against z.
Mesh plane_mesh(Vec2f size, int divisions);

// Facetted: 24 vertices, 12 triangles; every side covers the whole uv square.
Mesh box_mesh(Vec3f size);

// 8 divisions² triangles (71: 40,328; 500: 2,000,000): an octahedron whose sides are divided evenly in
// latitude and longitude, so that triangle areas differ by at most a factor of 2. u is the longitude,
// anticlockwise from +x seen from above, v the latitude from -y to +y; vertices on the seam and at the poles
// are duplicated. Smooth. The radius in direction d is radius + bump_amplitude * f(d), where f is the mean of
// three sines along the axes of bump_frequency radians per unit: about bump_frequency waves around a great
// circle. |bump_amplitude| < radius.
Mesh sphere_mesh(float radius, int divisions, float bump_amplitude, float bump_frequency);

// heights: width * height samples, rows from the top. Each becomes a vertex at height_scale times the sample;
// the top row is at -z and v = 1. size: metres along x and z. Smooth. Throws InputError for heights that are
// not finite.
Mesh heightfield_mesh(std::span<const float> heights, int width, int height, Vec2f size, float height_scale);

} // namespace marram
