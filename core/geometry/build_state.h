// SPDX-License-Identifier: Apache-2.0
// What the files that build a world share: build.cpp (the order of it all), build_meshes.cpp, build_curves.cpp, lent_geometry.cpp.
#pragma once

#include "core/geometry/build.h"
#include "core/geometry/device.h"
#include "core/math/clock.h"

#include <map>

namespace marram {

class LentGeometry;

// The curves of one procedural while they are being made.
struct CurveBuild {
    Procedural* procedural = nullptr;
    MarramOutput output{};
    std::vector<MarramPatch> patches;
    std::vector<uint32_t> attributes; // indices asked for
    CurveGeometry curves;
    std::shared_ptr<RTCGeometryTy> geometry;
    std::vector<float*> vertices, normals; // [time]
};

// A build on its way: what it is of, what it has come to.
struct Build {
    SceneGeometry& geometry;
    const BuildSettings& settings;
    const std::atomic<bool>& cancel;
    BuildProgress& progress;
    BuildStats& stats;
    KeptGeometry& kept; // of the frame before
    World world{};      // meshes: growth surfaces until all is made; without positions: not made yet
    std::vector<uint32_t> mesh_ids{};                              // [procedural] of those that make meshes
    std::vector<Procedural*> mesh_makers{};                        // [mesh ID], nullptr for the scene's
    std::vector<std::shared_ptr<RTCGeometryTy>> mesh_geometries{}; // [mesh ID], once they are traced
    std::vector<char> taken_over{}; // [mesh ID] growth surfaces of the frame before
    std::vector<std::shared_ptr<LentGeometry>>
        lent{};                      // to makers of meshes, which may look at it until the frame ends
    std::vector<CurveBuild> items{}; // in the order they were made
    std::vector<std::shared_ptr<RTCGeometryTy>> curves{}; // own the buffers that World::curves points into

    double open() const { return settings.frame + settings.shutter_open; }
    double close() const { return settings.frame + settings.shutter_close; }
    std::vector<double> times(uint32_t keys) const { return motion_times(open(), close(), keys); }
    // Whether the tolerance chooses how many.
    bool chooses_keys() const { return settings.motion_keys == 0 && open() < close(); }

    // Throws what Embree has reported, and Cancelled.
    void check_device() const {
        if (cancel.load()) throw Cancelled{};
        raise(*world.errors);
    }
};

// ---- build.cpp

std::shared_ptr<RTCSceneTy> new_scene(const Build& build, RTCSceneFlags flags);
void commit(Build& build, RTCScene scene, const char* phase);
// Brings what a procedural simulates to the frame, where it does.
void prepare(Build& build, Procedural& procedural, const MarramFrame& frame);

// Moves what a procedural has warned of so far to the build's statistics.
inline void take_warnings(Build& build, Procedural& procedural) {
    for (std::string& warning : procedural.take_warnings())
        build.stats.warnings.push_back(std::move(warning));
}

// ---- build_meshes.cpp

// Names the meshes of the world, and makes those of the scene.
void place_meshes(Build& build);
// Makes the growth surface of one procedural.
void make_mesh(Build& build, Procedural& procedural, uint32_t id);
// Puts the render meshes that procedurals make for the camera in the place of their growth surfaces.
void make_render_meshes(Build& build);
// Embree's geometry of a mesh, made once.
RTCGeometry mesh_geometry(Build& build, uint32_t id);
// The committed scene of some meshes, made once; nullptr for none.
RTCScene collider_scene(Build& build, const std::vector<uint32_t>& ids);

struct PosedMesh {
    std::vector<Vec3f> positions, normals;
};
// A mesh at any time. Throws what the procedural that makes it says.
PosedMesh pose_mesh(const Build& build, uint32_t id, double frame, bool with_normals);

// ---- build_curves.cpp

// How many motion keys the curves of a procedural are to have.
uint32_t keys_of_curves(Build& build, Procedural& procedural);
// Has one procedural make its curves.
void make_curves(Build& build, Procedural& procedural, uint32_t keys);
// Gives all curves that were made to Embree, in the scene's order.
void attach_curves(Build& build);

} // namespace marram
