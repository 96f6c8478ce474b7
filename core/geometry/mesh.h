// SPDX-License-Identifier: Apache-2.0
// Triangle meshes, read from files or built in, before they are passed to Embree.
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

struct MeshSides;

struct MeshLoading {
    bool smooth = true; // of a file without any normals: vertex_normals(), else facets
    bool flip = false;  // turn the mesh over: what was inside is outside
    // Of a mesh that deforms: its first shape. Its triangles are taken if this file has the same polygons,
    // whichever way these are wound and divided.
    const Mesh* first_shape = nullptr;
    MeshSides* sides = nullptr; // receives what settle_sides() found
    // Receives a line for uvs and normals that faces of an OBJ refer to and that the file does not have.
    std::vector<std::string>* warnings = nullptr;
};

// Reads .obj, .ply (ascii, binary of either byte order), or .vdb: the surface of the first level set of
// floats, with one vertex in each cell that it crosses (error: a few hundredths of a voxel where it is
// smooth). Polygons are triangulated, including concave ones. OBJ vertices with several uvs or normals are
// duplicated: the first stays at its place in the file, the others follow at the end. Normals come from the
// file; corners without one get that of vertex_normals(). Triangles that are wound against their neighbours
// are turned (mesh_sides.h). Materials, groups, lines, points, colours and free-form surfaces are ignored.
// Throws InputError with line and column (binary PLY: element and number) for: syntax errors, counts that do
// not match, indices out of range, polygons of fewer than 3 or more than 10,000 corners, level sets that are
// no narrow band, numbers that are not finite, coordinates beyond 1e18 (Embree silently drops such vertices),
// no triangles, more than 2^32 - 2 vertices or triangles. Cost: about 1 s for a million triangles as OBJ, 0.2
// s as binary PLY, without smoothing.
Mesh load_mesh(const std::string& path, const MeshLoading& loading);
inline Mesh load_mesh(const std::string& path, bool smooth) {
    return load_mesh(path, MeshLoading{.smooth = smooth});
}

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
