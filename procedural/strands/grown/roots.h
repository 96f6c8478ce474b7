// SPDX-License-Identifier: Apache-2.0
// Placement of strand roots.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/surface.h"

#include <functional>
#include <vector>

namespace marram {

// Places the roots of a groom on its surface in the bind pose, ordered so that neighbours are close in the
// list.
//
// Density: roots per square metre times the masks, within 2 % if masks are 1 and the surface is flat at the
// scale of the spacing. Count: exactly that many. Roots are at least `spacing` * 0.5 / sqrt(density) apart if
// density masks are 1 or absent. The result depends only on the description and the mesh, and is
// bit-identical at any thread count.
// Cost: about 0.4 us per root on 2 threads and 40 bytes of temporary memory; 8 bytes per root remain.
// Throws SceneFault if the masks leave too little room for the count. Once cancelled() is true, returns early
// with an incomplete result.
struct PlacedRoots {
    std::vector<Root> roots;
    std::vector<float> ranks; // [root], if there is a level of detail: the share from which on it exists
    size_t peak_bytes = 0;    // of the temporary candidates
};

// The greatest share of roots that is wanted at most `margin` metres of the bind pose from a triangle, 0 ... 1.
// Any thread.
using ShareAround = std::function<double(uint32_t triangle, double margin)>;

// share: of all roots, only those whose rank is below the share at their triangle, and few others: the same
// ones, with the same ranks, whatever the shares elsewhere. The fraction r of all roots was thrown before one
// of rank r. A count is then that of all, within 2 %; with a count, or where spacing is not 0, other
// roots are thrown than without a share. Cost: that of the roots that are wanted, and a share for each triangle.
// Throws SceneFault if more than 4e8 are wanted.
PlacedRoots place_roots(const Groom& groom, const Surface& bind, const std::function<bool()>& cancelled,
                        const ShareAround& share = {});

} // namespace marram
