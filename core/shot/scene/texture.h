// SPDX-License-Identifier: Apache-2.0
// Image textures for shaders. core/image/texture_file.h describes how they are stored.
#pragma once

#include "shaders/texture.h"

namespace marram {

// A TextureOpener. A file name with <UDIM> stands for one file for each unit square of uv (core/math/udim.h):
// none of them repeats, and where there is none the image is black. Throws InputError if the file is not an
// image, is truncated or has values that are not finite.
std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place);

} // namespace marram
