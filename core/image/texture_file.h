// SPDX-License-Identifier: Apache-2.0
// Images on surfaces, by OpenImageIO's texture system: tiles are read when a ray first needs them, and kept in a cache of
// limited size that all threads share.
//
// Files that are tiled and hold smaller copies of themselves in linear light (as `maketx` writes them) are used as they are. Any
// other is made into one when it is opened, colours turned to linear light first, since the mean of encoded values is
// darker than the mean of what they stand for: some 0.3 s a million pixels, in the directory for temporary files, from where
// it goes with the texture. Values beyond 0 ... 1 are cut there.
#pragma once

#include "core/image/image.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <memory>
#include <string>

namespace marram {

class TextureFile {
  public:
    virtual ~TextureFile() = default;
    // The mean over a square of `width` in uv around the place, which repeats outside the unit square; v runs up. 0 ... 1;
    // grey where the image has one channel. Thread-safe.
    virtual Vec3f at(const Vec2f& uv, float width) const = 0;
};

// Throws InputError, at the place, where the file is no image, is cut short or holds what is not finite.
std::shared_ptr<const TextureFile> open_texture_file(const std::string& file, ColorSpace space,
                                                     const Place& place);

} // namespace marram
