// SPDX-License-Identifier: Apache-2.0
// Levels what oblique winds cannot see. The page is in checkerboard.cpp.
#pragma once

#include "procedural/terrain/fields.h"

#include <cstddef>

namespace marram {

// `sand`, `sand_out`: whole units, as doubles; `ground`: metres; `flux`: kg / (m s); all rows of `pitch`. `part`: of the checkerboard's
// height that each quad takes away per unit of flux (1/8 at most is taken). `sand_out` is not `sand`.
void damp_checkerboard(int rows, int columns, bool periodic, double part, const float* ground,
                       const float* flux, const double* sand, size_t pitch, double* sand_out);

} // namespace marram
