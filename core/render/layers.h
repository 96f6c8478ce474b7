// SPDX-License-Identifier: Apache-2.0
// What a sample adds to the layers of the film. Shadow catchers add their alpha in resolve() (film.cpp).
#pragma once

#include "core/render/path.h"

namespace marram {

// sample: its number in the pixel's sequence. pixel: index in the film.
void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, uint32_t sample,
                Film& film, size_t pixel);

} // namespace marram
