// SPDX-License-Identifier: Apache-2.0
// What a film's samples tell about its noise while it is rendered: where samples differ, and which pixels need more.
// adaptive.cpp opens with the estimate.
#pragma once

#include "core/render/film.h"

namespace marram {

// Fills FilmPixel::deviation: a standard deviation, in units of luminance. O(pixels), between two passes.
void measure_spread(Film& film);

// Fills FilmPixel::converged; noise: a share of brightness, as RenderSettings::noise. Needs a layer
// "variance". False: none is left to be rendered. O(pixels), between two passes.
bool find_noisy(Film& film, double noise);

} // namespace marram
