// SPDX-License-Identifier: Apache-2.0
// Writes data layers (depth, normals, masks) as a PNG: a range of values is mapped to black ... white.
#pragma once

#include "core/image/image.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>

namespace marram {

// May be reversed: {20, 0} shows near values bright. black and white differ.
struct ValueRange {
    double black = 0.0, white = 1.0;
    bool operator==(const ValueRange&) const = default;
};

// Linear map from black ... white to 0 ... 65535, clamped at both ends. NaN gives 0.
inline uint16_t code_of(double value, const ValueRange& range) {
    const double share = (value - range.black) / (range.white - range.black);
    return std::isnan(share) ? uint16_t(0) : uint16_t(std::lround(65535.0 * std::clamp(share, 0.0, 1.0)));
}

// 16 bits, linear in the value, so that the middle of the range is middle grey; no gamma is written. One
// channel is written as grey, two as red and green, three as colour, four as colour and alpha; all use the
// range. The bytes depend on the arguments only.
void write_range_png(const std::string& path, int width, int height, int channels, const float* pixels,
                     const ValueRange& range, std::span<const Metadata> metadata);

} // namespace marram
