// SPDX-License-Identifier: Apache-2.0
// A layer that hands out a mask. Its page is in mask_layer.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

namespace marram {

LayerType mask_layer_type();

} // namespace marram
