// SPDX-License-Identifier: Apache-2.0
// A film in a file, as the name says: .exr with all layers, .png with the picture alone.
#pragma once

#include "core/image/image.h"
#include "core/render/film.h"

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// A layer that every scene has.
struct LayerHelp {
    std::string_view name, channels, help;
};
std::span<const LayerHelp> built_in_layers();

// ".exr" of "A.EXR".
std::string lower_extension(const std::string& path);

// Throws InputError unless the name says .exr or .png.
void check_picture_name(const std::string& path);

// "a.exr" -> "a.partial.exr": what is there of a picture that was interrupted.
std::string partial_name(const std::string& path);

// The film resolved; exposure in stops, for a PNG. Interrupts wait.
void save_picture(const std::string& path, const Film& film, double exposure,
                  const std::vector<Metadata>& metadata);

} // namespace marram
