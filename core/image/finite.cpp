// SPDX-License-Identifier: Apache-2.0
#include "core/image/image.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <cmath>

namespace marram {

void check_finite(const std::string& path, const Image& image) {
    for (size_t i = 0; i < image.pixels.size(); ++i) {
        if (std::isfinite(image.pixels[i])) continue;
        const size_t pixel = i / size_t(image.channels);
        throw InputError({path},
                         fmt::format("channel {} of pixel ({}, {}) is {}",
                                     image.channel_names[i % size_t(image.channels)],
                                     pixel % size_t(image.width), pixel / size_t(image.width),
                                     std::isnan(image.pixels[i]) ? "not a number" : "infinite"),
                         "fix that pixel; positions count from 0 at the top left");
    }
}

} // namespace marram
