// SPDX-License-Identifier: Apache-2.0
// The rest shape of each strand.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/surface.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <span>

namespace marram {

// Fills strands.rest (and rest_normal), root_normal and width for a patch's roots, and strands.noise_origin
// with the roots' positions at `bind` or now (Wind::noise_at_bind_frame). With collision, roots are raised
// above the skin by root_offset(). strands must have been resized to roots.size(). Segments of a strand are
// equally long and add up to the requested length. Cost: about 0.3 us per root + 15 ns per CV of a plain
// strand, single thread. guided: for a groom with guides; its blends belong to `roots`.
void expand(const Groom& groom, const Wind& wind, const SkinPoses& poses, std::span<const Root> roots,
            Strands& strands, const Guided* guided = nullptr);

// Upper bound of the strands' lengths, m.
double longest_strand(const Groom& groom);

// Extends `box` by bounds of all rest CVs of strands that grow on these vertices, 3 floats each.
void extend_by_rest(const Groom& groom, std::span<const float> positions, Eigen::AlignedBox3d& box);

} // namespace marram
