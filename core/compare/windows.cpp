// SPDX-License-Identifier: Apache-2.0
#include "core/compare/windows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <limits>

namespace marram {

std::vector<int> window_starts(int length, int window, int step) {
    std::vector<int> all;
    for (int at = 0; at + window < length; at += step) all.push_back(at);
    all.push_back(std::max(0, length - window));
    return all;
}

WorstWindow worst_window(const std::vector<float>& plane, int width, int height) {
    WorstWindow worst;
    worst.mean = -std::numeric_limits<double>::infinity();
    for (const int y : window_starts(height, local_window, local_step))
        for (const int x : window_starts(width, local_window, local_step)) {
            double sum = 0.0, count = 0.0;
            for (int j = y; j < std::min(y + local_window, height); ++j)
                for (int i = x; i < std::min(x + local_window, width); ++i) {
                    sum += double(plane[size_t(j) * size_t(width) + size_t(i)]);
                    count += 1.0;
                }
            if (!(sum / count <= worst.mean)) worst = {sum / count, x, y};
        }
    return worst;
}

std::string window_text(int width, int height) {
    return fmt::format("{} x {} pixels", std::min(local_window, width), std::min(local_window, height));
}

} // namespace marram
