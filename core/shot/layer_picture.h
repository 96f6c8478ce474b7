// SPDX-License-Identifier: Apache-2.0
// One layer of a frame as a PNG of its own, beside the picture: depth, normals, masks, to be looked at or to go on with.
#pragma once

#include "core/image/range_png.h"
#include "core/render/film.h"
#include "core/shot/shot.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct LayerPicture {
    std::string layer, file;
    std::optional<ValueRange> range; // that becomes black ... white; none: the layer's own
};

// What a layer ranges over by nature: colours, shares and strand_u from 0 to 1, normals from -1 to 1. nullopt for all else, such as depth
// and attributes.
std::optional<ValueRange> natural_range(const std::string& layer);

// In a picture's metadata: "depth 0 20".
std::string layer_text(const LayerPicture& picture);

// The film resolved. Colours (beauty, albedo) are written as pictures are, 8 bits and sRGB, beauty with the exposure; all else in 16 bits, in
// proportion to the value. Depth where nothing is hit counts as farther than all.
void save_layer_picture(const LayerPicture& picture, const Film& film, double exposure,
                        const std::vector<Metadata>& metadata);

} // namespace marram
