// SPDX-License-Identifier: Apache-2.0
// Image textures for shaders. core/image/texture_file.h describes how they are stored.
#pragma once

#include "shaders/texture.h"

namespace marram {

// A TextureOpener. Throws InputError if the file is not an image, is truncated or has values that are not
// finite.
std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place);

} // namespace marram
