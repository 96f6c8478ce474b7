// SPDX-License-Identifier: Apache-2.0
// What the files that build a world share: build.cpp (meshes, motion keys, the order of it all), build_curves.cpp.
#pragma once

#include "core/geometry/build.h"
#include "core/math/clock.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace marram {

// body(0), ... body(count - 1), which are cheap: thousands a task.
template <typename Body>
void parallel(size_t count, Body&& body) {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 8192), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) body(i);
    });
}

struct DeviceErrors { // the first one
    std::mutex lock;
    RTCError code = RTC_ERROR_NONE;
    std::string text;
};

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

    void check_device() const {
        if (cancel.load()) throw Cancelled{};
        const std::lock_guard guard(errors->lock);
        if (errors->code == RTC_ERROR_NONE) return;
        if (errors->code == RTC_ERROR_CANCELLED) throw Cancelled{};
        const bool memory = errors->code == RTC_ERROR_OUT_OF_MEMORY;
        throw InputError({"embree"},
                         memory ? "the scene does not fit into memory" : "Embree failed: " + errors->text,
                         memory ? "use fewer strands, CVs or motion keys" : "report it with the scene");
    }
};

// The world's meshes as the contract lists them, at the times of one procedural's motion keys. Meshes that move and have others
// themselves are posed anew for it: a drawn one is no farther off than the tolerance.
class LentMeshes {
  public:
    LentMeshes(const World& world, const SceneGeometry& geometry, std::vector<double> times);
    LentMeshes(const LentMeshes&) = delete;
    LentMeshes& operator=(const LentMeshes&) = delete;
    MarramFrame frame(const BuildSettings& settings, bool colliders);

  private:
    struct Lists {
        std::vector<const float*> positions, normals;
    };

    static MarramStatus pose(void* user, uint32_t index, double frame, float* positions, float* normals);

    const World& world_;
    const SceneGeometry& geometry_;
    std::vector<double> times_;
    std::vector<Lists> lists_;
    std::vector<std::vector<Vec3f>> posed_; // what lists_ points to beside the world
    std::vector<MarramMesh> meshes_;
};

// Refuses a procedural that says of its curves what cannot be.
void check_output(const Procedural& procedural, const MarramOutput& output);

// Phase 2: has all procedurals make their curves, with keys[i] motion keys for the i-th of them, and attaches them to the scene.
void add_curves(Build& build, const std::vector<uint32_t>& keys);

} // namespace marram
