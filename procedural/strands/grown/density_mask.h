// SPDX-License-Identifier: Apache-2.0
// The masks that scale the density of a groom, over its surface.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/surface.h"

namespace marram {

// The density masks over a surface, relative to `full`. A count depends only on the ratios of mask values, so
// faint masks need no more candidates than strong ones.
struct DensityMask {
    const Groom& groom;
    const Surface& bind;
    double full = 1.0;

    bool masked() const { return groom.density_masks.any(); }
    double at(Root root) const {
        const Vec3d weights = root_weights(groom.seed, root);
        return at(root.triangle, weights);
    }
    double at(uint32_t triangle, const Vec3d& weights) const {
        const double share = groom.density_masks(bind, triangle, weights);
        return std::min(share / full, 1.0);
    }
    bool keeps(Root root) const { return unit_double(root_hash(groom.seed, root, Purpose::mask)) < at(root); }
};

// False if the masks are 0 on the whole triangle, so that no candidates are sampled there.
bool may_grow(const DensityMask& mask, uint32_t triangle);

// Mean and greatest mask value over the surface, sampled densely enough to resolve a thousandth of the area.
struct MaskStatistics {
    double mean = 1.0, most = 1.0;
};
MaskStatistics mask_statistics(const DensityMask& mask, double area);

} // namespace marram
