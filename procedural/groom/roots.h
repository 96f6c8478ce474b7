// SPDX-License-Identifier: Apache-2.0
// Where strands grow.
#pragma once

#include "procedural/groom/description.h"
#include "procedural/groom/surface.h"

#include <functional>
#include <vector>

namespace marram {

// Places the roots of a groom on its surface at the bind pose, in an order that keeps neighbours together.
//
// Density: roots a square metre times the masks, within 2 % where masks are 1 and triangles are flat beside the spacing.
// Count: exactly that many. Two roots are never nearer than `spacing` * 0.5 / sqrt(density) where density masks are 1 or
// absent. The set is a function of the description and the mesh alone: any thread count gives the same bits.
// Cost: about 0.4 us a root on 2 threads and 40 bytes of passing memory; 8 bytes a root stay.
// Throws SceneFault where masks leave too little room for the count; returns early, incomplete, once cancelled() is true.
struct PlacedRoots {
    std::vector<Root> roots;
    size_t peak_bytes = 0; // of candidates, while they were there
};

PlacedRoots place_roots(const Groom& groom, const Surface& bind, const std::function<bool()>& cancelled);

} // namespace marram
