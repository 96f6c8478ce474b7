// SPDX-License-Identifier: Apache-2.0
// Fields along rays that run with the wind.
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
    double drift =
        0.0; // tangent of the wind's angle to the rows' normal, columns per row: at most 1 either way, 3.8 in a
             // wind field

    int row(int n) const { return backwards ? rows - 1 - n : n; }
    double spacing() const { return cell * std::hypot(1.0, drift); } // metres along the wind, from row to row
};

// Rays along the wind, at any angle to the grid: ray r is at column r + n drift in the n-th row downwind.
// Values are interpolated linearly between columns onto the rays and linearly back, once each, whatever the
// distance. On periodic ground a ray has more samples before the first row and after the last.
class DownwindRays {
  public:
    static constexpr int width = 16; // rays of a group, processed together

    // lead, tail: samples of a ray before the first row and after the last, on periodic ground.
    DownwindRays(const DownwindGrid& grid, int lead, int tail);

    int groups() const { return groups_; }
    int length() const { return grid_.rows + lead_ + tail_; } // samples of a ray
    int count() const { return count_; }                      // rays; the last group may have more
    size_t pitch() const { return size_t(groups_) * width; }  // values in one row of all rays

    // Reads one group's samples: length() rows of `width` values. `field`: rows of `field_pitch`.
    void gather(const float* field, size_t field_pitch, int group, float* samples) const;
    // Writes one group's samples to `rays`: rows of pitch() values, without lead and tail.
    void store(const float* samples, int group, float* rays) const;
    // Interpolates the rays back onto the grid; of values of 0 or more. In parallel over rows.
    void scatter(const float* rays, float* field, size_t field_pitch) const;

  private:
    struct Offset {
        int whole;
        float part;
    };
    Offset offset(int step) const;

    DownwindGrid grid_;
    int lead_, tail_;                   // 0 unless periodic
    int first_column_, count_, groups_; // first_column_: of the first ray, in the first row
};

} // namespace marram
