// SPDX-License-Identifier: Apache-2.0
// Image lookup for shaders. The renderer opens the images: it passes a TextureOpener to make_material().
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
    // The mean over a square of side `width` (uv) around `uv`. The image repeats outside the unit square; v
    // points up. Values are in [0, 1]; images with one channel give grey. Thread-safe.
    virtual Vec3f at(const Vec2f& uv, float width) const = 0;
};

enum class TextureContent { color, data }; // data: no colour space conversion

// Throws InputError with this place if the file cannot be used.
using TextureOpener = std::function<std::shared_ptr<const Texture>(
    const std::string& file, TextureContent content, const Place& place)>;

} // namespace marram
