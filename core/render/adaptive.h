// SPDX-License-Identifier: Apache-2.0
// Noise estimates of a film during rendering: the spread of samples, and the pixels that need more of them.
// adaptive.cpp describes the estimate.
#pragma once

#include "core/render/film.h"

namespace marram {

// Sets FilmPixel::luminance_stddev. O(pixels), called between two passes.
void estimate_deviation(Film& film);

// Sets FilmPixel::converged. noise: fraction of brightness, see RenderSettings::noise. Needs a layer
// "variance". Returns false if all pixels have converged. O(pixels), called between two passes.
bool update_convergence(Film& film, double noise);

} // namespace marram
