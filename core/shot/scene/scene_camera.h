// SPDX-License-Identifier: Apache-2.0
// The camera of a frame: position and target from the scene, moved by the keyed transform.
#pragma once

#include "core/render/camera.h"
#include "core/scene/description.h"

#include <span>

namespace marram {

// A camera that moves while the shutter is open gets as many poses, at most 65, as needed to keep the error
// of interpolation between them within 1/20 pixel: for directions anywhere on the film, and for positions
// at the target's distance. `off` receives the remaining error in pixels. Throws InputError if a key scales.
Camera camera_at(const SceneDescription& description, double frame, double* off = nullptr);

// Median distance, m, from the camera to the centers of the boxes whose centers are in view; infinite if
// none is.
double median_distance(const SceneDescription& description, double frame, std::span<const Box3f> boxes);

} // namespace marram
