// SPDX-License-Identifier: Apache-2.0
// Writes one layer of a frame, such as depth, normals or a mask, as a separate PNG beside the picture.
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
    std::optional<ValueRange> range; // values mapped to black and white; none: natural_range()
};

// Parses the value of --png, "depth:0-20=depth.####.png": a layer, the values mapped to black and white, a
// file. Without a range: "normal=n.png". Throws InputError with the column of the mistake.
LayerPicture parse_layer_picture(const std::string& text);

// The range of a layer that has one in any scene: of built_in_layers(), and 0 to 1 for gust and shield.
std::optional<ValueRange> natural_range(const std::string& layer);

// "variance, albedo, ...": the built-in layers that are not always written.
std::string names_of_extra_layers();

// The layer and its range as written to the picture's metadata: "depth 0 20".
std::string layer_text(const LayerPicture& picture);

// The film must be resolved. Colours (beauty, albedo) are written like pictures, 8 bits and sRGB, beauty with
// the exposure. All other layers are written with 16 bits, linear in the value. Depth is infinite where no
// surface is hit.
void save_layer_picture(const LayerPicture& picture, const Film& film, double exposure,
                        const std::vector<Metadata>& metadata);

} // namespace marram
