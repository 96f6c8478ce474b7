// SPDX-License-Identifier: Apache-2.0
// Values that are no light (depth, normals, masks) as a PNG: a range of them becomes black ... white.
#pragma once

#include "core/image/image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>

namespace marram {

// May be backwards: {20, 0} shows what is near bright. The two differ.
struct ValueRange {
    double black = 0.0, white = 1.0;
    bool operator==(const ValueRange&) const = default;
};

// 0 at black and below (of a range that is backwards: above), 65535 at white and beyond, in proportion between. NaN is 0.
inline uint16_t code_of(double value, const ValueRange& range) {
    const double share = (value - range.black) / (range.white - range.black);
    return std::isnan(share) ? uint16_t(0) : uint16_t(std::lround(65535.0 * std::clamp(share, 0.0, 1.0)));
}

// 16 bits, in proportion to the value, so that half-way is middle grey: nothing is said of gamma. One channel is grey, two are red and
// green, three colours, four colours and alpha, each over the range. The bytes depend on the arguments alone.
void write_range_png(const std::string& path, int width, int height, int channels, const float* pixels,
                     const ValueRange& range, std::span<const Metadata> metadata);

} // namespace marram
