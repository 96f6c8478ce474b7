// SPDX-License-Identifier: Apache-2.0
// A layer of dunes along drawn curves. The model's page is in dune_shape.cpp, the layer's in dune_layer.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

namespace marram {

LayerType dune_layer_type();

} // namespace marram
