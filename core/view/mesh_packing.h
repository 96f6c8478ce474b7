// SPDX-License-Identifier: Apache-2.0
// Meshes as a page draws them: with fewer triangles if they have many.
#pragma once

#include "core/geometry/world.h"
#include "core/view/wire.h"

#include <array>
#include <cstdint>
#include <vector>

namespace marram {

// Vertices of a mesh, one of each cell of a grid, and the triangles between them. The same vertices while
// the mesh moves.
struct DrawnMesh {
    uint64_t number = 0;            // another of each drawn_mesh()
    uint64_t topology = 0;          // of the mesh
    std::vector<uint32_t> vertices; // indices into the mesh's
    std::vector<std::array<uint32_t, 3>> triangles;
};

// max_triangles: about so many at most.
DrawnMesh drawn_mesh(const MeshGeometry& mesh, size_t max_triangles);

// Digest of its triangles: a DrawnMesh is valid while it is the same.
uint64_t topology_of(const MeshGeometry& mesh);

// Appends arrays at the first motion sample; returns { positions, normals } for the header. normals is -1
// of a facetted mesh.
nlohmann::json add_mesh_positions(const MeshGeometry& mesh, const DrawnMesh& drawn, WireMessage& message);

// The message "meshes". colors: [mesh], linear.
WireMessage meshes_message(const std::vector<MeshGeometry>& meshes, const std::vector<DrawnMesh>& drawn,
                           const std::vector<Vec3f>& colors);

} // namespace marram
