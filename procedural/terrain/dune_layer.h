// SPDX-License-Identifier: Apache-2.0
// A layer of dunes along drawn curves. The model's page is in dune_shape.cpp, the layer's in dune_layer.cpp.
#pragma once

#include "procedural/terrain/dune_shape.h"
#include "procedural/terrain/layer_types.h"

#include <string>

namespace marram {

LayerType dune_layer_type();

// The lines of a [[procedural.layer]] of this type that has these settings, but for its curves and how it is combined. The settings must
// be within the parameters' ranges; boundary noise is that of `seed`, of a dune whose settings have dune_noise_seed() of it.
std::string dune_text(const DuneSettings& settings, uint64_t seed);

// What the noise of a layer's curve comes from: the terrain's seed, the layer's, and the curve's number.
uint64_t dune_noise_seed(uint64_t terrain, uint64_t layer, uint64_t curve);

} // namespace marram
