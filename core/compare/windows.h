// SPDX-License-Identifier: Apache-2.0
// Sliding windows over a picture, and the worst of them: an error of a few pixels vanishes in the overall
// mean.
#pragma once

#include <string>
#include <vector>

namespace marram {

// Start positions of windows of this size along a side: every `step` pixels, and the last possible one. A
// single 0 if the side is shorter than the window.
std::vector<int> window_starts(int length, int window, int step);

constexpr int local_window = 16, local_step = 8; // side of a window, and step between windows, in pixels

struct WorstWindow {
    double mean = 0.0;
    int x = 0, y = 0; // its first pixel
};

// The greatest mean of `plane` over windows of 16 x 16 pixels; over the whole picture if it is smaller.
WorstWindow worst_window(const std::vector<float>& plane, int width, int height);

// The size of such a window as text: "16 x 16 pixels".
std::string window_text(int width, int height);

} // namespace marram
