// SPDX-License-Identifier: Apache-2.0
// Windows that slide over a picture, and the worst of them: a fault of a few pixels is lost in the mean of all.
#pragma once

#include <string>
#include <vector>

namespace marram {

// Where windows of so many pixels begin along a side: every `step`, and the last. One at 0 where the side is shorter.
std::vector<int> window_starts(int length, int window, int step);

constexpr int local_window = 16, local_step = 8; // pixels a side, and between windows

struct WorstWindow {
    double mean = 0.0;
    int x = 0, y = 0; // its first pixel
};

// The greatest mean of one number a pixel over windows of 16 x 16 pixels; of pictures that are smaller, over all there is.
WorstWindow worst_window(const std::vector<float>& plane, int width, int height);

// Such a window in words: "16 x 16 pixels".
std::string window_text(int width, int height);

} // namespace marram
