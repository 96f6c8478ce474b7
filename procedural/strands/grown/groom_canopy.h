// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "procedural/strands/grown/groom_instance.h"

namespace marram {

// Makes instance.canopy of the strands in the bind pose, if the groom asks for one and it is not made yet.
// Throws SceneFault where strands are instanced or their mesh moves: then they are no stand on ground.
// Cost: a strand of four CVs each.
void find_canopy(GroomInstance& instance);

} // namespace marram
