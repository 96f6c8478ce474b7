// SPDX-License-Identifier: Apache-2.0
// Settings that a scene leaves to the tolerance: CVs, rays of a shielding cone, step of jiggle, octaves of
// noise.
#pragma once

#include "procedural/groom/groom_instance.h"

namespace marram {

// Chooses them from the description and this frame only. If a renderer begins a frame again with other motion
// samples between the same ends, the earlier choice is kept. Warns if the tolerance cannot be reached.
// Returns the status of the host's pose().
MarramStatus choose_settings(GroomInstance& instance);

} // namespace marram
