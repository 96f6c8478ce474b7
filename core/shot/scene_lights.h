// SPDX-License-Identifier: Apache-2.0
// The [[light]] tables of a scene file as lights. Types and parameters: core/scene/schema.cpp.
#pragma once

#include "core/render/lights.h"
#include "core/scene/description.h"

#include <string>
#include <vector>

namespace marram {

// One light per table, in their order, so that a mesh finds its light by index; behind them the suns of daylight. Adds to `warnings`.
// Throws InputError.
LightDescription make_light(const Item& item, std::vector<LightDescription>& suns,
                            std::vector<std::string>& warnings);

} // namespace marram
