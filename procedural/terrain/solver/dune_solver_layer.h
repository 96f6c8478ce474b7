// SPDX-License-Identifier: Apache-2.0
// The layer dune_solver. See dune_solver_layer.cpp for the layer and solver/solver.cpp for the model.
#pragma once

#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/solver/solver.h"

namespace marram {

// Serializes a state, and reads it back. read_bytes() returns false if the bytes are no state with `samples`
// samples.
std::vector<char> bytes_of(const DuneState& state);
bool read_bytes(std::span<const char> bytes, size_t samples, DuneState& state);

LayerType dune_solver_layer_type();

} // namespace marram
