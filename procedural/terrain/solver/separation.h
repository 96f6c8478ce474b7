// SPDX-License-Identifier: Apache-2.0
// Flow separation: bubbles behind brinks and in front of steep faces. See separation.cpp for the model.
#pragma once

#include "core/math/simd.h"

#include <vector>

namespace marram {

// How the wind crosses the grid. All downwind stages advance from row to row, never along a row.
struct DownwindGrid {
    int rows = 0, columns = 0;
    bool periodic = false; // else the ground continues beyond the border at the border's height
    double cell = 1.0;
    bool backwards = false; // the wind crosses from the last row to the first
    double drift = 0.0;     // columns per row, -1 to 1

    int row(int step) const { return backwards ? rows - 1 - step : step; }
};

struct SeparationSettings {
    double steepest = 0.36397; // tangent: steeper faces cause a bubble (20 degrees)
    double lee = 0.25;         // steepest descent of a separated streamline (14 degrees)
    double windward = 0.36397; // steepest ascent of one in front of a face
    bool operator==(const SeparationSettings&) const = default;
};

// Computes `excess`, the height of each bubble's bounding streamline above the ground (metres, 0 without a
// bubble). `height`, `excess`: rows of `pitch` floats. `range`: highest minus lowest height.
class Separation {
  public:
    void find(const DownwindGrid& course, const SeparationSettings& settings, const float* height,
              double range, size_t pitch, float* excess);

  private:
    WideVector<float> rays_;
};

} // namespace marram
