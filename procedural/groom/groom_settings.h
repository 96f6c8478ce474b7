// SPDX-License-Identifier: Apache-2.0
// Settings that a scene leaves to the tolerance: CVs, rays of a shielding cone, step of jiggle, octaves of noise, motion of the skin.
#pragma once

#include "procedural/groom/groom_instance.h"

namespace marram {

// Sets them from the description and this frame alone. A renderer may begin a frame twice, at other motion samples between the same
// ends: what was chosen serves again. Warns where the tolerance cannot be reached. Returns what the host's pose() returned.
MarramStatus choose_settings(GroomInstance& instance);

} // namespace marram
