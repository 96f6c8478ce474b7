// SPDX-License-Identifier: Apache-2.0
// How far apart two meshes with different vertices are.
#pragma once

#include "core/geometry/world.h"

#include <cstdint>

namespace marram {

struct MeshDistance { // sums, in metres
    double squares = 0.0, count = 0.0, worst = 0.0;
    void add(double distance);
    void add(const MeshDistance& other);
    double rms() const;
};

// Distances of mesh `mesh` of a world, whose scene need not be committed, from the vertices of another mesh, along the
// normals there: at most a twentieth of its size. Takes 10^5 vertices at most, at regular intervals, and two rays each.
MeshDistance mesh_distance(const World& world, uint32_t mesh, const MeshGeometry& from);

} // namespace marram
