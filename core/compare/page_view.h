// SPDX-License-Identifier: Apache-2.0
// What a page shows of two pictures: at which exposures, in which colours, and where to look.
#pragma once

#include "core/compare/compare.h"

#include <string>
#include <vector>

namespace marram::page {

using Pixels = std::vector<float>; // 3 a pixel, linear

// A browser shows 8 bits a channel, which hold a few stops of light. So a picture goes into the page up to three times: at its base
// exposure; what is white there, some stops darker; what is nearly black there, some stops brighter. The latter two are black
// elsewhere (and take few bytes): the lighter of the two numbers is the picture's, whatever the exposure.
struct Exposures {
    int base = 0;                                   // stops: beyond the file's own numbers
    int highlights = 0, shadows = 0;                // stops from the base; 0: nothing is there to be shown
    double white_test = 0.0, white_reference = 0.0; // share of pixels that are white at the base
    double lost = 0.0;                              // of both, that stay white
};
Exposures exposures_of(const Picture::Layer& test, const Picture::Layer& reference, bool display);

enum class Part { base, highlights, shadows };
Pixels exposed(const Picture::Layer& layer, const Exposures& exposures, Part part);

// A layer that is no light: in proportion, between the least and the greatest of the reference's numbers.
Pixels in_proportion(const Picture::Layer& layer, const Picture::Layer& reference);

// Each pixel's greatest difference of a channel.
std::vector<float> differences(const Picture::Layer& a, const Picture::Layer& b);

// From black to nearly white; what is beyond `white` is so, too.
Pixels heat_map(const std::vector<float>& values, double white);
std::string heat_gradient(); // the same colours, of CSS

// Where a heat map is white: at the greatest, if that is not of a few pixels beside which all others would be black.
double white_of(const std::vector<float>& values);

struct Region {
    int x = 0, y = 0, width = 0, height = 0;
};
Pixels cut(const Pixels& rgb, int width, const Region& region);

// The square with the greatest sum, of a size to be seen in the whole.
Region worst_region(const std::vector<float>& values, int width, int height);

// As much around it as shows what it is a part of: an eighth of the picture at least.
Region context_of(const Region& region, int width, int height);

// The square that a test of noise is about: the smallest that fails; if the whole alone fails, the one that is nearest to its limit.
// nullptr where none fails.
const ScaleResult* failing_square(const std::vector<ScaleResult>& scales);
// "red"; "" where nothing differs.
std::string channel_of(const ScaleResult& scale, const Picture& picture);
Region region_of(const ScaleResult& square, int width, int height);

} // namespace marram::page
