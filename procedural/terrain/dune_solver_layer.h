// SPDX-License-Identifier: Apache-2.0
// The layer dune_solver: dunes that the wind makes of the sand below. Its page is in dune_solver_layer.cpp, the model's in solver/solver.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/solver/solver.h"

namespace marram {

// What a state holds, as bytes, and back; false: they are not such a state of that many samples.
std::vector<char> bytes_of(const DuneState& state);
bool read_bytes(std::span<const char> bytes, size_t samples, DuneState& state);

LayerType dune_solver_layer_type();

} // namespace marram
