// SPDX-License-Identifier: Apache-2.0
// Noise estimates of a film during rendering: the standard deviation of samples, and the pixels that need
// more of them. adaptive.cpp describes the estimate.
#pragma once

#include "core/render/film.h"

namespace marram {

// Sets FilmPixel::luminance_stddev, from pixels up to stddev_radius away in x and y. O(pixels), called
// between two passes.
inline constexpr uint32_t stddev_radius = 2; // 25 pixels of pilot_samples estimate it to within a tenth
void update_luminance_stddev(Film& film);

// Adaptive sampling decides after each round: a usable variance of a pixel needs as many samples.
inline constexpr uint32_t samples_per_round = 16;

// Sets FilmPixel::converged and returns the number of pixels that have not converged. noise_threshold:
// fraction of brightness, see RenderSettings. Needs a layer "variance". O(pixels), called between two passes.
size_t mark_converged_pixels(Film& film, double noise_threshold);

} // namespace marram
