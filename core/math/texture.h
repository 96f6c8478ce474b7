// SPDX-License-Identifier: Apache-2.0
// Image lookup, for shaders and for what reads image files.
#pragma once

#include "core/math/vec.h"

namespace marram {

// What is beyond the unit square of uv: the pixels at its border, or the image again.
enum class Wrap : unsigned char { clamp, repeat };

class Texture {
  public:
    virtual ~Texture() = default;
    // The mean over a square of side `width` (uv) around `uv`; v points up. Values are in [0, 1]; images with fewer than
    // three channels give grey. Thread-safe.
    virtual Vec3f at(const Vec2f& uv, float width, Wrap wrap) const = 0;
};

} // namespace marram
