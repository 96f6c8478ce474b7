// SPDX-License-Identifier: Apache-2.0
// The samples around the mesh, with what is computed for each of them.
#pragma once

#include "procedural/terrain/fields.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace marram {

// Samples along a side of the blocks in which one sample is traced for rooms: half a metre, at most 16.
inline int ruin_block_side(double cell) { return int(std::clamp(std::floor(0.5 / cell), 1.0, 16.0)); }

// The samples of a rectangle, row by row: 67 bytes a sample. (i, j) are relative to the rectangle's first
// sample.
struct RuinGrid {
    Rect rect;
    int nx = 0, nz = 0;
    std::vector<double> ground, scour, deposit; // m
    std::vector<double> level, floor, cap;      // m: used by the sweeps
    std::vector<char> wall_x, wall_z, solid;    // wall to the next sample in x, z; inside a solid
    std::vector<double> room, walls;            // enclosure, 0 to 1; height of the walls, m

    explicit RuinGrid(const Rect& r)
        : rect(r), nx(r.i1 - r.i0), nz(r.j1 - r.j0), ground(count()), scour(count()), deposit(count()),
          level(count()), floor(count()), cap(count()), wall_x(count()), wall_z(count()), solid(count()),
          room(count()), walls(count()) {}
    size_t count() const { return size_t(nx) * size_t(nz); }
    size_t at(int i, int j) const { return size_t(j) * size_t(nx) + size_t(i); }
};

} // namespace marram
