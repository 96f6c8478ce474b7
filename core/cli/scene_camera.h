// SPDX-License-Identifier: Apache-2.0
// The camera of a frame, as a scene describes it: where it looks, moved by its keys.
#pragma once

#include "core/render/camera.h"
#include "core/scene/description.h"

namespace marram {

// A camera that moves while the shutter is open has as many poses as it takes for what lies between them to be off by less than
// a twentieth of a pixel, anywhere on the film and, at the target's distance, in place; at most 65. Throws InputError where a key scales.
Camera camera_at(const SceneDescription& description, double frame);

} // namespace marram
