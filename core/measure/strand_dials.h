// SPDX-License-Identifier: Apache-2.0
// Dials of strands in the wind that need more than a list of values: an oracle to measure against, a law by
// which the error falls, several parameters that change together. This and bend.cpp are the only code of core
// that names parameters of the wind.
#pragma once

#include "core/measure/dials.h"

#include <array>

namespace marram {

// Sweeps of declarations that these dials contain.
inline constexpr std::array sweeps_of_strand_dials = {"wind.collision.rotation_steps", "wind.shielding.rays",
                                                      "wind.jiggle.step", "cvs"};

// Adds the dials of what the scene uses, and says why the others are left out.
void add_strand_dials(const Shot& shot, DialList& list);

} // namespace marram
