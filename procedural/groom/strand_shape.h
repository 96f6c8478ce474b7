// SPDX-License-Identifier: Apache-2.0
// The shape of each strand at rest.
#pragma once

#include "procedural/groom/description.h"
#include "procedural/groom/surface.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <span>

namespace marram {

// The same mesh twice: at the bind pose, which fixes shape and comb, and at the time asked for, which carries the strands.
struct GrowthPoses {
    Surface bind, now;
};

// Fills strands.rest (and rest_normal) for a patch's roots, strands.anchor with the roots' places at `bind` or now, as the wind
// says, root_normal and width. Where strands collide their roots stand above the skin by root_offset().
// strands must have been resized to roots.size(). Segments of a strand are equally long; the whole is as long as asked.
// Cost: about 0.3 us a root + 15 ns a CV of a plain strand, single thread.
// guided: of a groom with guides. Its blends are of `roots`.
void expand(const Groom& groom, const Wind& wind, const GrowthPoses& poses, std::span<const Root> roots,
            Strands& strands, const Guided* guided = nullptr);

// A length that no strand of the groom exceeds.
double longest_strand(const Groom& groom);

// Widens `box` by all rest CVs of strands that grow on these vertices, 3 floats each.
void extend_by_rest(const Groom& groom, std::span<const float> positions, Eigen::AlignedBox3d& box);

} // namespace marram
