// SPDX-License-Identifier: Apache-2.0
// The fields of a terrain: bedrock, sand and masks, sampled on one grid.
//
// Sand is stored as integers, so that layers which move it conserve it exactly. Everything else is a float.
// Height = bedrock + sand. Grids are stored row by row: sample (i, j) at j * nx + i.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Sand thickness in units of 2^-32 m (0.23 nm). Sums below 2^31 m fit.
using SandUnits = int64_t;
inline constexpr double sand_units_per_metre = 0x1p32;
// Rounds to the nearest unit; clamps to 2^30 m in magnitude.
inline SandUnits sand_units(double metres) {
    return std::llrint(std::clamp(metres, -0x1p30, 0x1p30) * sand_units_per_metre);
}
inline double sand_metres(SandUnits sand) { return double(sand) * (1.0 / sand_units_per_metre); }

// The sample grid: nx by nz samples, `cell` metres apart; sample (i, j) is at (x0 + i cell, z0 + j cell).
struct Domain {
    int nx = 0, nz = 0;
    double cell = 1.0, x0 = 0.0, z0 = 0.0;

    size_t count() const { return size_t(nx) * size_t(nz); }
    size_t index(int i, int j) const { return size_t(j) * size_t(nx) + size_t(i); }
    double x(int i) const { return x0 + i * cell; }
    double z(int j) const { return z0 + j * cell; }
    bool operator==(const Domain&) const = default;
};

// Samples [i0, i1) x [j0, j1).
struct Rect {
    int i0 = 0, j0 = 0, i1 = 0, j1 = 0;
    bool empty() const { return i0 >= i1 || j0 >= j1; }
};

// A mask: 0 to 1 at every sample. `values` has Domain::count() floats.
struct MaskView {
    std::string name;
    const float* values = nullptr;
};

// The terrain below a layer. Does not own the arrays.
struct Fields {
    const float* bedrock = nullptr;
    const SandUnits* sand = nullptr;
    std::span<const MaskView> masks;

    double height(size_t sample) const { return double(bedrock[sample]) + sand_metres(sand[sample]); }
};

// A set of tiles of `side` x `side` samples: the unit of parallel work and of re-evaluation after an edit.
class Tiles {
  public:
    static constexpr int side = 64;

    Tiles() = default;
    explicit Tiles(const Domain& domain, bool all = false)
        : domain_(domain), columns_((domain.nx + side - 1) / side), rows_((domain.nz + side - 1) / side),
          in_(size_t(columns_) * size_t(rows_), char(all)) {}

    int columns() const { return columns_; }
    int rows() const { return rows_; }
    int count() const { return int(std::count(in_.begin(), in_.end(), char(1))); }
    bool none() const { return count() == 0; }
    bool all() const { return count() == int(in_.size()); }
    bool has(int column, int row) const { return in_[at(column, row)] != 0; }
    void add(int column, int row) { in_[at(column, row)] = 1; }
    void add(const Tiles& others) {
        for (size_t t = 0; t < in_.size(); ++t) in_[t] = char(in_[t] | others.in_[t]);
    }
    // Adds all tiles with a sample inside the box (metres).
    void add_box(const Vec2d& lower, const Vec2d& upper);
    // The set dilated by `metres`. Infinity: all tiles, unless the set is empty.
    Tiles grown(double metres) const;
    Rect rect(int column, int row) const {
        return {column * side, row * side, std::min((column + 1) * side, domain_.nx),
                std::min((row + 1) * side, domain_.nz)};
    }
    // The rectangles of all tiles in the set, row by row.
    std::vector<Rect> rects() const;

  private:
    size_t at(int column, int row) const { return size_t(row) * size_t(columns_) + size_t(column); }
    Domain domain_;
    int columns_ = 0, rows_ = 0;
    std::vector<char> in_;
};

} // namespace marram
