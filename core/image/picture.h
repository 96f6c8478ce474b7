// SPDX-License-Identifier: Apache-2.0
// A picture and its layers, as `marram compare` reads them from any file format.
#pragma once

#include "core/image/image.h"

#include <string>
#include <vector>

namespace marram {

// Layers by name: R, G and B (or a grey Y) form the layer "", A is "alpha", albedo.R belongs to "albedo".
struct Picture {
    struct Layer {
        std::string name;
        std::vector<std::string> channels;
        std::vector<float> pixels; // interleaved
    };
    int width = 0, height = 0, samples = 0; // samples 0: unknown
    std::string limits;                     // limits of golden frames, from the metadata
    std::vector<Layer> layers;
    bool grey = false;              // grey in the file; here R, G and B are equal
    bool display = false;           // colours in the file were encoded for a display
    bool half = false;              // stored as half floats
    std::string read_as = "linear"; // assumed encoding of the file; also "sRGB", "gamma 1.8"
    const Layer* find(const std::string& name) const;
};

// Throws InputError, also if comparing pictures of this size would take more than 8 GiB. A picture with a
// single channel, or with Y and at most one other (normally alpha), is grey: three equal channels. Colour
// channels may be named r, g, b, and may have a prefix ("Beauty.R") if there are no others. Straight-alpha
// colour (PNG) is multiplied by alpha, so that it does not depend on the file format; colour under an alpha
// of 0 is taken as it is, as write_png() writes it.
Picture read_picture(const std::string& path);

// The pixels of a layer with its channels in the given order. Both must have the same channels.
std::vector<float> in_order(const Picture::Layer& layer, const std::vector<std::string>& channels);

} // namespace marram
