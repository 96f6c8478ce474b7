// SPDX-License-Identifier: Apache-2.0
// A layer that hands out a mask. Its page is in mask_layer.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

namespace marram {

LayerType mask_layer_type();
// Throws SceneFault where a mask cannot have that name.
void check_mask_name(const std::string& name, const std::string& place);

} // namespace marram
