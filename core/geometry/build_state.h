// SPDX-License-Identifier: Apache-2.0
// What the files that build a world share: build.cpp (meshes, motion keys, the order of it all), build_curves.cpp.
#pragma once

#include "core/geometry/build.h"
#include "core/geometry/device.h"
#include "core/math/clock.h"

namespace marram {

// A build on its way: what it is of, what it has come to.
struct Build {
    SceneGeometry& geometry;
    const BuildSettings& settings;
    const std::atomic<bool>& cancel;
    BuildProgress& progress;
    BuildStats& stats;
    World world;
    std::shared_ptr<DeviceErrors> errors;
    std::vector<std::shared_ptr<RTCGeometryTy>> curves; // own the buffers that World::curves points into

    double open() const { return settings.frame + settings.shutter_open; }
    double close() const { return settings.frame + settings.shutter_close; }
    std::vector<double> times(uint32_t keys) const { return motion_times(open(), close(), keys); }
    // Whether the tolerance chooses how many.
    bool chooses_keys() const { return settings.motion_keys == 0 && open() < close(); }

    // Throws what Embree has reported, and Cancelled.
    void check_device() const {
        if (cancel.load()) throw Cancelled{};
        raise(*errors);
    }
};

// Refuses a procedural that says of its curves what cannot be.
void check_output(const Procedural& procedural, const MarramOutput& output);

// Phase 2: has all procedurals make their curves, with keys[i] motion keys for the i-th of them, and attaches them to the scene.
void add_curves(Build& build, const std::vector<uint32_t>& keys);

} // namespace marram
