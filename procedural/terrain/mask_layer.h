// SPDX-License-Identifier: Apache-2.0
// A layer that outputs a mask. It is documented in mask_layer.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

namespace marram {

LayerType mask_layer_type();
// Throws SceneFault if the name is not allowed for a mask.
void check_mask_name(const std::string& name, const std::string& place);

} // namespace marram
