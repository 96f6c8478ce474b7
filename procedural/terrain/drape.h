// SPDX-License-Identifier: Apache-2.0
// Sand follows the rock beneath without a seam. The page of the model is in drape.cpp.
#pragma once

#include "procedural/terrain/fields.h"

#include <functional>

namespace marram {

// Longer drapes are taken as this one, in cells.
inline constexpr double most_drape_cells = 10.0;

// Sand and the ground that it lies on, in units of sand (whole numbers), row by row, Domain::count() of each. Moves the sand in place; `drape`
// in metres, above 0. |ground| and sand up to 2^52 units. False: cancelled, and the sand is as it was.
bool drape_sand(const Domain& domain, const double* ground, double* sand, double drape,
                const std::function<bool()>& cancelled);

} // namespace marram
