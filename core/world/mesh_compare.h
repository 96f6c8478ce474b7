// SPDX-License-Identifier: Apache-2.0
// How far a mesh is from the vertices of another one.
#pragma once

#include "core/geometry/world.h"

#include <cstdint>

namespace marram {

struct MeshDistance { // sums over vertices: m^2, their number, and the greatest distance, m
    double squares = 0.0, count = 0.0, worst = 0.0;
    void add(double distance);
    void add(const MeshDistance& other);
    double rms() const;
};

// Distances of mesh `mesh` of a world from the vertices of `from` along their normals, at rest or at the
// first motion sample. A vertex without a hit within a twentieth of the longest edge of from's box counts as
// that far. At most 10^5 vertices, at regular intervals; two rays each. The world's scene need not be
// committed.
MeshDistance mesh_distance(const World& world, uint32_t mesh, const MeshGeometry& from);

} // namespace marram
