// SPDX-License-Identifier: Apache-2.0
// What a frame cost, as JSON for other programs.
#pragma once

#include "core/geometry/build.h"
#include "core/render/integrator.h"

#include <string>
#include <vector>

namespace marram {

struct FrameStats {
    double frame = 0.0;
    int threads = 1;
    uint32_t camera_poses = 1;                   // that the shutter sees it at
    double load = 0.0, trace = 0.0, total = 0.0; // wall seconds
    BuildStats build;
    RenderStats render;
};

// Writes one object, or for several frames a list of them. Keys as the design fixes them; stages that did not run are 0.
void write_stats(const std::string& path, const std::vector<FrameStats>& frames);

// Seconds on a clock that only goes forward.
double wall_seconds();

} // namespace marram
