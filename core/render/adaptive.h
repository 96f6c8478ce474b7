// SPDX-License-Identifier: Apache-2.0
// What a film's samples tell about its noise while it is rendered: where samples differ, and which pixels need more.
#pragma once

#include "core/render/film.h"

namespace marram {

// Fills Film::spread.
void measure_spread(Film& film);

// Fills Film::done: which pixels are as good as RenderSettings::noise asks for. Needs a layer "variance". False: none is left.
bool find_noisy(Film& film, double noise);

} // namespace marram
