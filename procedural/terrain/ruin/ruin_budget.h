// SPDX-License-Identifier: Apache-2.0
// The sand budget of a ruin, in whole units of sand. It is documented in ruin.cpp.
#pragma once

#include "procedural/terrain/ruin/ruin.h"
#include "procedural/terrain/ruin/ruin_grid.h"

namespace marram {

// Takes the scour of the grid from `sand` and adds the deposits, scaled to the budget. `sand`: all samples of
// the domain; `supply`: 0 to 1. Sets taken, given and supplied of `result`. Cost: one thread; 16 bytes a
// sample of the grid.
void ruin_balance_sand(const RuinGrid& grid, const Domain& domain, double supply, SandUnits* sand,
                       RuinResult& result);

} // namespace marram
