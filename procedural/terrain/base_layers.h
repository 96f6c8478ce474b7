// SPDX-License-Identifier: Apache-2.0
// Layers that a terrain begins with: flat, noise, image. Their page is in base_layers.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

namespace marram {

LayerType flat_layer_type();
LayerType noise_layer_type();
LayerType image_layer_type();

} // namespace marram
