// SPDX-License-Identifier: Apache-2.0
// A film in a file, as the name says: .exr with all layers, .png with the picture alone.
#pragma once

#include "core/image/image.h"
#include "core/render/film.h"

#include <string>
#include <vector>

namespace marram {

// Names of the channels of an attribute in an EXR; 1 to 4 components.
std::vector<std::string> attribute_channels(uint32_t components);

// ".exr" of "A.EXR".
std::string lower_extension(const std::string& path);

// Throws InputError unless the name says .exr or .png.
void check_picture_name(const std::string& path);

// "a.exr" -> "a.partial.exr": what is there of a picture that was interrupted.
std::string partial_name(const std::string& path);

// The film resolved; exposure in stops, for a PNG.
void save_picture(const std::string& path, const Film& film, double exposure,
                  const std::vector<Metadata>& metadata);

} // namespace marram
