// SPDX-License-Identifier: Apache-2.0
// Images on surfaces, for shaders: core/image/texture_file.h says how they are kept.
#pragma once

#include "shaders/texture.h"

namespace marram {

// A TextureOpener. Throws InputError where the file is no image, is cut short or holds what is not finite.
std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place);

} // namespace marram
