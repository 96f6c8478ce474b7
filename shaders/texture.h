// SPDX-License-Identifier: Apache-2.0
// Image lookup for shaders. The renderer opens the images: it passes a TextureOpener to make_material().
#pragma once

#include "core/math/problem.h"
#include "core/math/vec.h"

#include <functional>
#include <memory>
#include <string>

namespace marram {

// What is beyond the unit square of uv: the pixels at its border, or the image again.
enum class Wrap : unsigned char { clamp, repeat };

class Texture {
  public:
    virtual ~Texture() = default;
    // The mean over a square of side `width` (uv) around `uv`; v points up. Values are in [0, 1]; images with
    // one channel give grey. Thread-safe.
    virtual Vec3f at(const Vec2f& uv, float width, Wrap wrap) const = 0;
};

enum class TextureContent { color, data }; // data: no colour space conversion

// Throws InputError with this place if the file cannot be used.
using TextureOpener = std::function<std::shared_ptr<const Texture>(
    const std::string& file, TextureContent content, const Place& place)>;

} // namespace marram
