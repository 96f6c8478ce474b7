// SPDX-License-Identifier: Apache-2.0
// Relaxes sand to its angle of repose, for fusion.cpp: the model is in fusion_relaxer.cpp.
#pragma once

#include "core/math/simd.h"
#include "procedural/terrain/mesh/fusion.h"

#include <functional>
#include <memory>
#include <vector>

namespace marram {

inline constexpr int fusion_block_columns = 16, fusion_block_rows = 8; // quads of a block

// Height differences between neighbours, in sand units: tangent times sample distance. Triangles above `trigger` move, until
// they are at `target`.
struct FusionSlopes {
    double trigger, target;
};

// One grid level: the samples, or one for 2^level by 2^level of them (fusion_coarsen_row). Each row stores its even columns
// first, then the odd ones, so the corners of eight quads of one colour are contiguous.
class FusionGrid {
  public:
    FusionGrid(int columns, int rows)
        : nx(columns), nz(rows), half(((nx + 1) / 2 + lanes - 1) / lanes * lanes + lanes),
          block_columns((nx + fusion_block_columns - 1) / fusion_block_columns),
          block_rows((nz + fusion_block_rows - 1) / fusion_block_rows),
          ground(std::make_unique_for_overwrite<double[]>(count())),
          sand(std::make_unique_for_overwrite<double[]>(count())), active(blocks()), changed(blocks()) {}

    size_t at(int i, int j) const { return row(j) + size_t(i & 1) * size_t(half) + size_t(i >> 1); }
    size_t row(int j) const { return size_t(j) * 2 * size_t(half); }
    size_t count() const { return row(nz); }
    size_t blocks() const { return size_t(block_columns) * size_t(block_rows); }
    size_t block(int column, int r) const { return size_t(r) * size_t(block_columns) + size_t(column); }
    int tile_columns() const { return (nx + Tiles::side - 1) / Tiles::side; }
    int tile_rows() const { return (nz + Tiles::side - 1) / Tiles::side; }
    double height(size_t k) const { return ground[k] + sand[k]; }
    // Zeroes the padding after row j, which is loaded with full vectors.
    void clear_padding(int j) {
        for (const int odd : {0, 1})
            for (int k = (nx + 1 - odd) / 2; k < half; ++k) {
                const size_t s = row(j) + size_t(odd) * size_t(half) + size_t(k);
                ground[s] = sand[s] = 0.0;
            }
    }

    const int nx, nz, half, block_columns, block_rows;
    std::unique_ptr<double[]> ground, sand; // sand units; `sand` holds whole numbers
    std::vector<char> active, changed;      // per block of quads; see fusion_sweep
};

// The hierarchy of grids, the finest first.
class FusionRelaxer {
  public:
    FusionRelaxer(const Domain& domain, double repose, int cycles, const std::function<bool()>& cancelled)
        : repose_(repose), cell_(domain.cell), cycles_(cycles), cancelled_(cancelled) {
        grids_.push_back(std::make_unique<FusionGrid>(domain.nx, domain.nz));
    }

    FusionGrid& finest() { return *grids_[0]; }
    // Squared height difference of the steepest triangle with sand at all corners. Overwrites finest().active.
    double steepest_squared();
    // Returns false if cancelled. If it does not settle, result.settled is false.
    bool relax(FusionResult& result);

  private:
    FusionSlopes fine_slopes() const;
    void add_grids();
    bool cascade();
    bool stop() const { return cancelled_ && cancelled_(); }

    double repose_, cell_;
    int cycles_;
    const std::function<bool()>& cancelled_;
    std::vector<std::unique_ptr<FusionGrid>> grids_;
};

} // namespace marram
