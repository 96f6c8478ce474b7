// SPDX-License-Identifier: Apache-2.0
// What a shader asks of an image on a surface. Who opens images is up to the renderer: it hands make_material() an opener.
#pragma once

#include "core/math/problem.h"
#include "core/math/vec.h"

#include <functional>
#include <memory>
#include <string>

namespace marram {

class Texture {
  public:
    virtual ~Texture() = default;
    // The mean over a square of `width` in uv around the place, which repeats outside the unit square; v runs up. 0 ... 1, as
    // shares of light are; grey where the image has one channel. Thread-safe.
    virtual Vec3f at(const Vec2f& uv, float width) const = 0;
};

enum class TextureContent { color, data }; // data: numbers that no colour space applies to

// Throws InputError, at the place, where the file cannot be used.
using TextureOpener = std::function<std::shared_ptr<const Texture>(
    const std::string& file, TextureContent content, const Place& place)>;

} // namespace marram
