// SPDX-License-Identifier: Apache-2.0
// Wind fields that a person draws, as an image or by curves. See wind_field.cpp.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/solver/winds.h"

#include <string>
#include <vector>

namespace marram {

// Both throw SceneFault with `place` if the field turns the wind by more than WindField::max_turn, or is not
// finite. `wind`: unit vector of the wind's mean direction, x and z.
WindField wind_field_of_image(const MarramGrid& grid, const Domain& domain, const std::string& place);
WindField wind_field_along(const std::vector<DrawnCurve>& curves, double reach, const Domain& domain,
                           const Vec2d& wind, const std::string& place);

} // namespace marram
