// SPDX-License-Identifier: Apache-2.0
// Views of two pictures for the comparison page: exposures, colours and regions.
#pragma once

#include "core/compare/compare.h"

#include <string>
#include <vector>

namespace marram::page {

using Pixels = std::vector<float>; // 3 a pixel, linear

// Browsers show 8 bits a channel, which cover a few stops. So the page contains a picture up to three times:
// at its base exposure; pixels that are white there, some stops darker; pixels that are nearly black there,
// some stops brighter. The latter two are black elsewhere (and small in bytes). The maximum of the images is
// the picture at any exposure.
struct Exposures {
    int base = 0;                                   // stops, relative to the file's values
    int highlights = 0, shadows = 0;                // stops relative to the base; 0: no such image
    double white_test = 0.0, white_reference = 0.0; // fraction of pixels that are white at the base
    double lost = 0.0;                              // fraction of all pixels that stay white
};
Exposures exposures_of(const Picture::Layer& test, const Picture::Layer& reference, bool display);

enum class Part { base, highlights, shadows };
Pixels exposed(const Picture::Layer& layer, const Exposures& exposures, Part part);

// A data layer: values mapped linearly, 0 or the reference's minimum, if lower, to black, its maximum to
// white.
Pixels map_linearly(const Picture::Layer& layer, const Picture::Layer& reference);

// Maximum difference over the channels of each pixel.
std::vector<float> differences(const Picture::Layer& a, const Picture::Layer& b);

// Colour map from black to nearly white; values above `white` are clamped.
Pixels heat_map(const std::vector<float>& values, double white);
std::string heat_gradient(); // the same colours as a CSS gradient

// The value that a heat map shows white: the maximum, or less if only a few pixels reach it, so that the
// others are not black.
double heat_white(const std::vector<float>& values);

struct Region {
    int x = 0, y = 0, width = 0, height = 0;
};
Pixels cut(const Pixels& rgb, int width, const Region& region);

// The square with the greatest sum of values, large enough to be visible in the whole picture.
Region worst_region(const std::vector<float>& values, int width, int height);

// The region with its surroundings: at least 32 pixels, an eighth of the picture's width and twice the
// region.
Region context_of(const Region& region, int width, int height);

// The square to show for a failed noise test: the smallest that fails, or, if only the whole picture fails,
// the one closest to its limit. nullptr if nothing fails.
const ScaleResult* failing_square(const std::vector<ScaleResult>& scales);
// Channel name such as "red"; "" if nothing differs.
std::string channel_of(const ScaleResult& scale, const Picture& picture);
Region region_of(const ScaleResult& square, int width, int height);

} // namespace marram::page
