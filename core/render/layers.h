// SPDX-License-Identifier: Apache-2.0
// What a sample adds to the layers of the film. A layer's sums are followed by its number of samples. Shadow catchers add
// their alpha in resolve() (film.cpp).
#pragma once

#include "core/render/path.h"

namespace marram {

// pixel_sums: Film::sums of the pixel.
void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, const Film& film,
                double* pixel_sums);

} // namespace marram
