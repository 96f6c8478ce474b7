// SPDX-License-Identifier: Apache-2.0
// Noise estimates of a film during rendering: the standard deviation of samples, and the pixels that need
// more of them. adaptive.cpp describes the estimate.
#pragma once

#include "core/render/film.h"

namespace marram {

// Sets FilmPixel::luminance_stddev. O(pixels), called between two passes.
void update_luminance_stddev(Film& film);

// Sets FilmPixel::converged and returns the number of pixels that have not converged. noise_threshold:
// fraction of brightness, see RenderSettings. Needs a layer "variance". O(pixels), called between two passes.
size_t mark_converged_pixels(Film& film, double noise_threshold);

} // namespace marram
