// SPDX-License-Identifier: Apache-2.0
// A mesh seen from above, as heights on a grid.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <cstddef>
#include <vector>

namespace marram {

// Sample (i, j) is at x0 + i cell, z0 + j cell, metres.
struct HeightGrid {
    int nx = 0, nz = 0;
    double cell = 1.0, x0 = 0.0, z0 = 0.0;
    std::vector<float> heights; // [j * nx + i], metres

    size_t index(int i, int j) const { return size_t(j) * size_t(nx) + size_t(i); }
};

// The same with about 2^20 samples at most: means over squares of samples, those at the far borders smaller.
HeightGrid coarsened(HeightGrid grid);

// The highest point of the mesh above each sample, at its first motion sample; where there is none, a
// smooth continuation of what is around. A cell is as wide as the short sides of the mesh's triangles are
// in the mean, so that the vertices of a terrain are its samples, but the grid has at least 256 samples
// along its longer side and at most 2^20 in all; finer meshes are averaged. Empty if the mesh has no area
// seen from above, or has a coordinate that is not finite. Cost: linear in triangles and samples, on one
// thread.
HeightGrid heights_from_above(const MarramMesh& mesh);

} // namespace marram
