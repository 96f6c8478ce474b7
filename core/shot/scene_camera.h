// SPDX-License-Identifier: Apache-2.0
// The camera of a frame, as a scene describes it: where it looks, moved by its keys.
#pragma once

#include "core/render/camera.h"
#include "core/scene/description.h"

#include <span>

namespace marram {

// A camera that moves while the shutter is open has as many poses as it takes for what lies between them to be off by less than
// a twentieth of a pixel, anywhere on the film and, at the target's distance, in place; at most 65: `off`, pixels, says what is left. Throws InputError where
// a key scales.
Camera camera_at(const SceneDescription& description, double frame, double* off = nullptr);

// The camera's distance from the middle of the boxes whose middle it sees: the median, m; infinite where it sees none.
double median_distance(const SceneDescription& description, double frame, std::span<const Box3f> boxes);

} // namespace marram
