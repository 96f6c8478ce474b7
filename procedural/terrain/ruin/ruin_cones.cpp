// SPDX-License-Identifier: Apache-2.0
// The sweeps that compute the lower envelope of cones.
#include "procedural/terrain/ruin/ruin_cones.h"

#include <algorithm>
#include <cmath>

namespace marram {

// Takes the seed of a neighbour if it gives a lower level. Returns true if the level fell.
bool RuinCones::take(size_t k, int i, int j, size_t from) {
    double& level = grid_.level[k];
    const double most = std::min(level, grid_.cap[k]);
    if (!(grid_.level[from] < most)) return false;
    const size_t seed = seed_[from], nx = size_t(grid_.nx);
    if (seed == seed_[k]) return false;
    const double x = double(i) - double(seed % nx), z = double(j) - double(seed / nx);
    const double v = base_[seed] + rise_ * std::sqrt(x * x + z * z);
    if (!(v < most)) return false;
    if (v > grid_.floor[k]) {
        level = v, seed_[k] = seed;
        return true;
    }
    if (!(grid_.floor[k] < most)) return false;
    level = base_[k] = grid_.floor[k], seed_[k] = k;
    return true;
}

// One pass in the given directions. Returns true if any level fell.
bool RuinCones::sweep(bool right, bool down) {
    bool fell = false;
    const auto nx = size_t(grid_.nx);
    for (int y = 0; y < grid_.nz; ++y) {
        const int j = down ? y : grid_.nz - 1 - y;
        for (int x = 0; x < grid_.nx; ++x) {
            const int i = right ? x : grid_.nx - 1 - x;
            const size_t k = grid_.at(i, j);
            if (!(grid_.level[k] > grid_.floor[k])) continue; // already at the floor
            if (i > 0 && !grid_.wall_x[k - 1]) fell = take(k, i, j, k - 1) || fell;
            if (i + 1 < grid_.nx && !grid_.wall_x[k]) fell = take(k, i, j, k + 1) || fell;
            if (j > 0 && !grid_.wall_z[k - nx]) fell = take(k, i, j, k - nx) || fell;
            if (j + 1 < grid_.nz && !grid_.wall_z[k]) fell = take(k, i, j, k + nx) || fell;
        }
    }
    return fell;
}

} // namespace marram
