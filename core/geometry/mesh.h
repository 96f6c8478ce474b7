// SPDX-License-Identifier: Apache-2.0
// Triangle meshes: what is read from files and built in, before it goes to Embree.
#pragma once

#include "core/math/vec.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace marram {

// Invariants after loading: every index < positions.size(); every number finite; normals and uvs are empty or one a vertex;
// the three vectors have Embree's 16 spare bytes behind them where they are shared with it.
struct Mesh {
    std::vector<Vec3f> positions;                 // object space
    std::vector<Vec3f> normals;                   // unit; empty: facetted
    std::vector<Vec2f> uvs;                       // empty where there are none
    std::vector<std::array<uint32_t, 3>> triangles; // anticlockwise seen from outside
};

} // namespace marram
