// SPDX-License-Identifier: Apache-2.0
// Writes a film to a file: .exr with all layers, .png with the picture only.
#pragma once

#include "core/image/image.h"
#include "core/render/film.h"

#include <string>
#include <vector>

namespace marram {

// EXR channel names of an attribute with 1 to 4 components.
std::vector<std::string> attribute_channels(uint32_t components);

// Throws InputError unless the name ends in .exr or .png.
void check_picture_name(const std::string& path);

// "a.exr" -> "a.partial.exr", the name of a picture whose render was interrupted.
std::string partial_name(const std::string& path);

// All layers of a film as an EXR has them, the picture first as R, G, B, A. They point into `rgba` and the
// film, which must be resolved.
struct PictureLayers {
    std::vector<float> rgba;
    std::vector<Layer> layers;
};
PictureLayers picture_layers(const Film& film);

// Metadata by which files are known again.
inline constexpr const char* digest_key = "marram:digest";
inline constexpr const char* frame_key = "marram:frame";
inline constexpr const char* layer_key = "marram:layer"; // name and range of a layer's picture
inline constexpr const char* unfinished = "partial";     // value of digest_key in unfinished pictures

// What a picture's file says of it. seconds: of rendering.
std::vector<Metadata> picture_metadata(const Film& film, const std::string& scene, double frame,
                                       double seconds, const std::string& digest);

// Throws InputError if a file of this name exists that is not an unfinished picture.
void check_partial_name(const std::string& partial);

// Removes the unfinished picture that an earlier run has left.
void remove_partial(const std::string& picture);

// The film must be resolved. exposure: stops, used for PNG only.
void save_picture(const std::string& path, const Film& film, double exposure,
                  const std::vector<Metadata>& metadata);

} // namespace marram
