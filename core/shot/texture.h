// SPDX-License-Identifier: Apache-2.0
// Images on surfaces, by OpenImageIO's texture system: tiles are read when a ray first needs them, and kept in a cache of
// limited size that all threads share.
//
// Files that are tiled and hold smaller copies of themselves in linear light (as `maketx` writes them) are used as they are. Any
// other is made into one when the scene is loaded, colours turned to linear light first, since the mean of encoded values is
// darker than the mean of what they stand for: some 0.3 s a million pixels, in the directory for temporary files, from where
// it goes with the texture. Values beyond 0 ... 1 are cut there.
#pragma once

#include "shaders/texture.h"

namespace marram {

// A TextureOpener. Throws InputError where the file is no image, is cut short or holds what is not finite.
std::shared_ptr<const Texture> open_texture(const std::string& file, TextureContent content,
                                            const Place& place);

} // namespace marram
