// SPDX-License-Identifier: Apache-2.0
// How the wind crosses the grid, and fields along rays that run with it.
#pragma once

#include "core/math/simd.h"

#include <cmath>
#include <cstddef>

namespace marram {

// How the wind crosses the grid. All downwind stages advance from row to row, never along a row.
struct DownwindGrid {
    int rows = 0, columns = 0;
    bool periodic = false; // else the ground continues beyond the border at the border's height
    double cell = 1.0;
    bool backwards = false; // the wind crosses from the last row to the first
    double drift = 0.0;     // columns per row: -1 to 1, in a wind field up to 3.8

    int row(int step) const { return backwards ? rows - 1 - step : step; }
    double spacing() const { return cell * std::hypot(1.0, drift); } // metres along the wind, from row to row
};

// Rays along the wind, at any angle to the grid: ray r is at column r + n drift in the n-th row downwind. Values
// are interpolated linearly between columns onto the rays and linearly back, once each, whatever the distance.
// On periodic ground a ray has more samples before the first row and after the last.
class DownwindRays {
  public:
    static constexpr int width = 16; // rays of a group, processed together

    // before, after: samples of a ray before the first row and after the last, on periodic ground.
    DownwindRays(const DownwindGrid& grid, int before, int after);

    int groups() const { return groups_; }
    int length() const { return grid_.rows + before_ + after_; } // samples of a ray
    size_t pitch() const { return size_t(groups_) * width; }     // of a row of rays

    // Reads one group's samples: length() rows of `width` values. `field`: rows of `field_pitch`.
    void gather(const float* field, size_t field_pitch, int group, float* samples) const;
    // Writes one group's samples to `rays`: rows of pitch() values, without those before and after.
    void store(const float* samples, int group, float* rays) const;
    // Interpolates the rays back onto the grid. In parallel over rows.
    void scatter(const float* rays, float* field, size_t field_pitch) const;

  private:
    struct Offset {
        int whole;
        float part;
    };
    Offset offset(int step) const;

    DownwindGrid grid_;
    int before_, after_;         // 0 unless periodic
    int first_, count_, groups_; // first_: the first ray
};

} // namespace marram
