// SPDX-License-Identifier: Apache-2.0
// Ranges of the settings of a mass desert.
#pragma once

#include "procedural/terrain/mass/mass_desert.h"

namespace marram {

// Clamps settings to the range in which the formulas are valid. Values from a scene are already in range.
MassSettings bounded_mass_settings(MassSettings s);

} // namespace marram
