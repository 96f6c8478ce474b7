// SPDX-License-Identifier: Apache-2.0
// Settings of the build and the integrator, from a scene's film, camera and globals.
#pragma once

#include "core/render/integrator.h"
#include "core/shot/shot.h"
#include "core/world/build.h"

#include <string>
#include <utility>
#include <vector>

namespace marram {

std::pair<uint32_t, uint32_t> film_size(const Shot& shot); // pixels

// Bytes that a film of these layers takes at most, in any world with or without shadow catchers: sums, counts,
// states of pixels, resolved values. Not the copy that is written: what building a BVH takes is free by then.
uint64_t film_bytes(uint32_t width, uint32_t height, const std::vector<std::string>& layers, bool catchers);

// For the camera's levels of detail, but on growth surfaces.
BuildSettings build_settings(const Shot& shot, double frame);
// The camera over the shutter.
CameraSamples camera_samples(const Shot& shot, double frame);
RenderSettings render_settings(const Shot& shot, double frame);

// Curve attributes that materials and image layers need.
std::vector<std::string> wanted_attributes(const Shot& shot, const std::vector<std::string>& layers);

} // namespace marram
