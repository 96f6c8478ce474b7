// SPDX-License-Identifier: Apache-2.0
// Where the wind leaves the ground: bubbles behind brinks and before steep faces. The page is in separation.cpp.
#pragma once

#include "core/math/simd.h"

#include <vector>

namespace marram {

// How a wind crosses a grid of rows, as all stages that go downwind see it: from row to row, never along one.
struct DuneCourse {
    int rows = 0, columns = 0;
    bool periodic = false; // else the ground goes on beyond the border as high as at it
    double cell = 1.0;
    bool backwards = false; // from the last row to the first
    double drift = 0.0;     // columns a row; -1 to 1

    int row(int step) const { return backwards ? rows - 1 - step : step; }
};

struct SeparationSettings {
    double steepest = 0.36397; // tangent: faces above it make a bubble (20 degrees)
    double lee = 0.25;         // steepest descent of a streamline that has separated (14 degrees)
    double windward = 0.36397; // steepest ascent of one before a face
    bool operator==(const SeparationSettings&) const = default;
};

// Writes how far the streamline that bounds each bubble is above the ground (metres, 0 where there is none). `height`, `excess`:
// rows of `pitch` floats. `range`: highest minus lowest height.
class Separation {
  public:
    void find(const DuneCourse& course, const SeparationSettings& settings, const float* height, double range,
              size_t pitch, float* excess);

  private:
    WideVector<float> rays_;
};

} // namespace marram
