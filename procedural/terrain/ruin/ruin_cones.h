// SPDX-License-Identifier: Apache-2.0
// Limits the slope of the sand: the lower envelope of cones on a grid.
#pragma once

#include "procedural/terrain/ruin/ruin_grid.h"

#include <cstddef>
#include <numeric>
#include <vector>

namespace marram {

// Lower envelope of cones on a grid: level = min over seeds of level(seed) + rise * (distance in cells). Each
// sample stores its seed and passes it to neighbours without a wall between (distance transform: Danielsson
// 1980). Levels only fall, never below `floor`. Only values below `cap` are accepted.
//
// `level`, `floor`, `cap`: those of the grid, m; `rise`: m a cell. Cost: up to 32 rounds of four passes over
// all samples, on one thread; 16 bytes a sample.
class RuinCones {
  public:
    RuinCones(RuinGrid& grid, double rise) : grid_(grid), rise_(rise), seed_(grid.count()) {
        std::iota(seed_.begin(), seed_.end(), size_t(0));
        base_ = grid.level;
    }
    // Lowers the levels of the grid until none falls any more, in at most 32 rounds.
    void settle() {
        constexpr int most = 32; // rounds: enough for a path around 32 corners
        for (int round = 0; round < most; ++round) {
            bool fell = false;
            for (const int d : {0, 1, 2, 3}) fell = sweep(d & 1, d & 2) || fell;
            if (!fell) return;
        }
    }

  private:
    bool sweep(bool right, bool down);
    bool take(size_t k, int i, int j, size_t from);

    RuinGrid& grid_;
    double rise_;
    std::vector<size_t> seed_;
    std::vector<double> base_; // the level of a seed
};

} // namespace marram
