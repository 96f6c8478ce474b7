// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/shot/shot.h"

#include <atomic>
#include <string>

namespace marram {

// What a scene contains and its estimated cost, as text: what `marram info SCENE` prints. Builds the geometry
// of the scene's first frame without motion, and tries motion keys; throws InputError and Cancelled.
std::string scene_summary(Shot& shot, const std::atomic<bool>& cancel);

// What procedurals say that they do in the shot: of strands, the wind. After a frame has been built.
std::string summaries_of_procedurals(const Shot& shot);

} // namespace marram
