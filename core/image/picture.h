// SPDX-License-Identifier: Apache-2.0
// A picture and its layers, as `marram compare` reads them from a file of whatever format.
#pragma once

#include "core/image/image.h"

#include <string>
#include <vector>

namespace marram {

// The picture's layers by name: "R", "G", "B", or a grey "Y", are "", "A" is "alpha", "albedo.R" is of "albedo".
struct Picture {
    struct Layer {
        std::string name;
        std::vector<std::string> channels;
        std::vector<float> pixels; // interleaved
    };
    int width = 0, height = 0, samples = 0; // 0: not known
    std::string limits;                     // metadata of golden frames
    std::vector<Layer> layers;
    bool grey = false;              // in the file; R, G and B are equal here
    bool display = false;           // its colours were encoded for a display
    bool half = false;              // stored as half floats
    std::string read_as = "linear"; // or "sRGB", "gamma 1.8": what its colours were taken for
    const Layer* find(const std::string& name) const;
};

// Throws InputError, also where comparing pictures of its size would take more than 8 GiB. A picture whose only channel, alpha aside, is Y,
// or that has but one channel, is grey: three equal channels. Colours may be called r, g, b, and have a prefix ("Beauty.R") where no others
// are there. Colour is multiplied by alpha where it is not in the file (PNG), so that it is the same in whatever format it was written;
// what lies under an alpha of 0 is gone.
Picture read_picture(const std::string& path);

// Channels of a layer in the order of another's, which has the same.
std::vector<float> in_order(const Picture::Layer& layer, const std::vector<std::string>& channels);

} // namespace marram
