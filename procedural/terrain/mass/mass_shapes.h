// SPDX-License-Identifier: Apache-2.0
// The shape of each kind of dune of a mass desert. Sizes and profiles are described in mass_shapes.cpp.
#pragma once

#include "procedural/terrain/mass/mass_desert.h"
#include "procedural/terrain/mass/mass_math.h"

namespace marram {

// Sets crests, width, length and the settings of height and slopes, for a dune whose kind and height are set.
// The crests are in metres, x downwind and y across, from the dune's place. The settings must be within their
// ranges.
void make_mass_shape(const MassSettings& s, const MassHash& random, MassDune& dune);

} // namespace marram
