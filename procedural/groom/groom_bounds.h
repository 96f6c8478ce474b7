// SPDX-License-Identifier: Apache-2.0
// Boxes that enclose strands whatever the wind does.
#pragma once

#include "procedural/groom/groom_instance.h"

namespace marram {

// All strands at all motion samples, widths and clearances included.
Eigen::AlignedBox3d bounds_of_strands(const GroomInstance& instance);

// All rest CVs, now and in the past that jiggle looks at: where gusts are evaluated.
Eigen::AlignedBox3d bounds_at_rest(const GroomInstance& instance);

// The box and the strands of one patch.
void find_patch(const GroomInstance& instance, uint32_t index, MarramPatch* out);

} // namespace marram
