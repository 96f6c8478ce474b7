// SPDX-License-Identifier: Apache-2.0
// Meshes from files.
#pragma once

#include "core/geometry/mesh.h"
#include "core/math/problem.h"

namespace marram {

struct MeshSides;

struct MeshLoading {
    bool smooth = true; // of a file without any normals: vertex_normals(), else facets
    bool flip = false;  // turn the mesh over: what was inside is outside
    // Of a mesh that deforms: its first shape, whose triangles are used again if this file has the same
    // polygons, however these are wound and divided.
    const Mesh* first_shape = nullptr;
    MeshSides* sides = nullptr; // receives what settle_sides() found
    // Receives a warning if faces of an OBJ refer to uvs or normals that the file does not have.
    std::vector<Problem>* warnings = nullptr;
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

} // namespace marram
