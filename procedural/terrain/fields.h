// SPDX-License-Identifier: Apache-2.0
// What a terrain is made of: bedrock, sand and masks, sampled on one grid.
//
// Sand is counted in integers, so that what a layer moves from sample to sample is neither made nor lost. Everything else is a float.
// Height = bedrock + sand. A grid is stored row by row: sample (i, j) at j * nx + i.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Sand of one sample in units of 2^-32 m: 0.23 nm. Sums of 2^31 samples of 1 m fit.
using SandUnits = int64_t;
inline constexpr double sand_units_a_metre = 0x1p32;
// The nearest number of units, within 2^30 m.
inline SandUnits sand_units(double metres) {
    return std::llrint(std::clamp(metres, -0x1p30, 0x1p30) * sand_units_a_metre);
}
inline double sand_metres(SandUnits sand) { return double(sand) * (1.0 / sand_units_a_metre); }

// Where the samples lie: nx by nz of them, `cell` metres apart; sample (i, j) at (x0 + i cell, z0 + j cell).
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

// The terrain below a layer. Borrowed.
struct Fields {
    const float* bedrock = nullptr;
    const SandUnits* sand = nullptr;
    std::span<const MaskView> masks;

    double height(size_t sample) const { return double(bedrock[sample]) + sand_metres(sand[sample]); }
};

// A set of tiles of `side` x `side` samples: the unit of parallel work and of what an edit evaluates again.
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
    // Tiles that hold a sample within the box (metres).
    void add_box(const Vec2d& lower, const Vec2d& upper);
    // These and all tiles that hold a sample within `metres` of one of theirs; infinity: all, where there is one.
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
