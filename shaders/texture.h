// SPDX-License-Identifier: Apache-2.0
// How shaders get images: the renderer opens them and passes a TextureOpener to make_material().
#pragma once

#include "core/math/problem.h"
#include "core/math/texture.h"

#include <functional>
#include <memory>
#include <string>

namespace marram {

enum class TextureContent { color, data }; // data: no colour space conversion

// Throws InputError with this place if the file cannot be used.
using TextureOpener = std::function<std::shared_ptr<const Texture>(
    const std::string& file, TextureContent content, const Place& place)>;

} // namespace marram
