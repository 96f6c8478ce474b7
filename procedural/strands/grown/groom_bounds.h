// SPDX-License-Identifier: Apache-2.0
// Bounding boxes of strands that hold for any wind.
#pragma once

#include "procedural/strands/grown/groom_instance.h"

namespace marram {

// All strands at all motion samples, widths and clearances included.
Eigen::AlignedBox3d bounds_of_strands(const GroomInstance& instance);

// All rest CVs, now and at the past samples that jiggle uses. Gusts are evaluated in this box.
Eigen::AlignedBox3d bounds_at_rest(const GroomInstance& instance);

// The box and the range of strands of one patch.
MarramPatch patch_bounds(const GroomInstance& instance, uint32_t index);

} // namespace marram
