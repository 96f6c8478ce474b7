// SPDX-License-Identifier: Apache-2.0
// Lets sand thin out along the rock below without a seam. The model is described in drape.cpp.
#pragma once

#include "procedural/terrain/fields.h"

#include <functional>

namespace marram {

// Upper limit of the drape length, in cells; longer ones are clamped.
inline constexpr double max_drape_cells = 10.0;

// Moves the sand in place. `ground` and `sand`: whole sand units, up to 2^52 in magnitude, row by row,
// Domain::count() each. `drape`: metres, above 0. Returns false if cancelled; the sand is then unchanged.
bool drape_sand(const Domain& domain, const double* ground, double* sand, double drape,
                const std::function<bool()>& cancelled);

} // namespace marram
