// SPDX-License-Identifier: Apache-2.0
// Image textures, by OpenImageIO's texture system: tiles are read when a ray first needs them, into a cache
// of limited size that all threads share.
//
// Tiled files with MIP levels, linear and with values in 0 ... 1 (as `maketx` writes them), are used as they
// are. Other files are converted when they are opened: colours are made linear first, since the mean of
// encoded values is darker than the mean of the light, and values are clamped to 0 ... 1. This takes about
// 0.3 s a million pixels. The converted file is in the directory for temporary files and is removed with the
// texture.
#pragma once

#include "core/image/image.h"
#include "core/math/problem.h"
#include "core/math/texture.h"

#include <memory>
#include <string>

namespace marram {

// Throws InputError at `place` if the file is not an image, is truncated or has non-finite pixels.
std::shared_ptr<const Texture> open_texture_file(const std::string& file, ColorSpace space,
                                                 const Place& place);

} // namespace marram
