// SPDX-License-Identifier: Apache-2.0
// Damps checkerboard patterns under oblique winds. See checkerboard.cpp for the model.
#pragma once

#include "procedural/terrain/fields.h"

#include <cstddef>

namespace marram {

// `sand`, `sand_out`: whole units, as doubles; `ground`: metres; `flux`: kg / (m s); all with rows of
// `pitch`. `part`: fraction of the checkerboard's height that each quad removes per unit of flux; the product
// is at most 1/8. `sand_out` must not be `sand`.
void damp_checkerboard(int rows, int columns, bool periodic, double part, const float* ground,
                       const float* flux, const double* sand, size_t pitch, double* sand_out);

} // namespace marram
