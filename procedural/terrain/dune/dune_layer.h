// SPDX-License-Identifier: Apache-2.0
// A layer of dunes along drawn curves. See dune_layer.cpp for the layer and dune_shape.cpp for the model.
#pragma once

#include "procedural/terrain/dune/dune_shape.h"
#include "procedural/terrain/layer_types.h"

#include <string>

namespace marram {

LayerType dune_layer_type();

// The lines of a [[procedural.layer]] of this type with these settings, without its curves and shape
// parameters. The settings must be within the parameters' ranges. `seed`: the layer's seed; for the same
// boundary noise the settings' seed must be dune_noise_seed() of it.
std::string dune_text(const DuneSettings& settings, uint64_t seed);

// Noise seed of one curve, from the terrain's seed, the layer's seed and the curve's index.
uint64_t dune_noise_seed(uint64_t terrain, uint64_t layer, uint64_t curve);

} // namespace marram
