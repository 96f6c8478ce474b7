// SPDX-License-Identifier: Apache-2.0
// Piecewise constant distributions in one and two dimensions, sampled by inversion of the cumulative
// distribution (Pharr, Jakob, Humphreys, "Physically Based Rendering", appendix A). The mapping is monotone,
// so stratified numbers stay stratified.
//
// Sums are doubles. A cell of weight 0 is never sampled: the search finds the last cell whose cumulative sum
// is <= the random number, and the sum of an empty cell equals that of its successor.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace marram {

class Distribution1D {
  public:
    struct Choice {
        size_t cell;
        double within; // position in the cell, 0 <= within < 1: again uniform
    };

    Distribution1D() = default;
    // weights >= 0; if all are 0, the distribution is uniform.
    explicit Distribution1D(std::span<const double> weights) : sums_(weights.size() + 1, 0.0) {
        for (size_t i = 0; i < weights.size(); ++i) sums_[i + 1] = sums_[i] + weights[i];
        total_ = sums_.back();
        for (size_t i = 1; i < sums_.size(); ++i)
            sums_[i] = total_ > 0.0 ? sums_[i] / total_
                                    : static_cast<double>(i) / static_cast<double>(weights.size());
        if (!weights.empty()) sums_.back() = 1.0;
    }

    bool empty() const { return sums_.size() < 2; }
    size_t size() const { return sums_.empty() ? 0 : sums_.size() - 1; }
    double total() const { return total_; } // sum of the original weights
    double probability(size_t cell) const { return sums_[cell + 1] - sums_[cell]; }

    Choice sample(double random) const {
        // Branchless binary search: half of the data-dependent branches would be mispredicted.
        size_t cell = 0;
        for (size_t left = size(); left > 1; left -= left / 2)
            cell += sums_[cell + left / 2] <= random ? left / 2 : 0;
        while (cell > 0 && !(probability(cell) > 0.0)) --cell; // the last cells may be empty
        const double within = (random - sums_[cell]) / probability(cell);
        return {cell, std::clamp(within, 0.0, one_below_1)};
    }

  private:
    static constexpr double one_below_1 = 1.0 - 0x1p-53;
    std::vector<double> sums_;
    double total_ = 0.0;
};

class Distribution2D {
  public:
    struct Choice {
        size_t column, row;
        double x, y; // position in the cell
    };

    Distribution2D() = default;
    Distribution2D(std::span<const double> weights, size_t width) {
        assert(width > 0 && weights.size() % width == 0);
        std::vector<double> totals;
        for (size_t row = 0; row < weights.size() / width; ++row) {
            rows_.emplace_back(weights.subspan(row * width, width));
            totals.push_back(rows_.back().total());
        }
        by_row_ = Distribution1D(totals);
    }

    double total() const { return by_row_.total(); }
    double probability(size_t column, size_t row) const {
        return by_row_.probability(row) * rows_[row].probability(column);
    }
    Choice sample(double a, double b) const {
        const Distribution1D::Choice row = by_row_.sample(b);
        const Distribution1D::Choice column = rows_[row.cell].sample(a);
        return {column.cell, row.cell, column.within, row.within};
    }

  private:
    std::vector<Distribution1D> rows_;
    Distribution1D by_row_;
};

} // namespace marram
