// SPDX-License-Identifier: Apache-2.0
// Shared by the files that build a world: build.cpp (the order of steps), build_meshes.cpp, build_curves.cpp,
// lent_geometry.cpp.
#pragma once

#include "core/math/clock.h"
#include "core/world/build.h"
#include "core/world/device.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <span>

namespace marram {

class LentGeometry;

// The curves of one procedural while they are being made.
struct CurveBuild {
    Procedural* procedural = nullptr;
    MarramOutput output{};
    std::vector<MarramPatch> patches;
    std::vector<uint32_t> attributes;     // indices of the requested ones
    std::vector<float*> attribute_values; // [attributes] of all curves
    CurveGeometry curves;                 // of lazy curves moved away when they are attached
    std::shared_ptr<RTCGeometryTy> geometry;
    std::vector<float*> vertices, normals;     // [time]
    float widened = 1.0F;                      // factor of the radii (BuildSettings::widening)
    bool has_parts = false;                    // curves of two keys are parts of their own (curve_parts.h)
    bool lazy = false;                         // patches are made when a ray meets them (lazy_curves.h)
    std::vector<uint32_t> sample_patches;      // lazy: patches that are made all the same, to choose settings
    std::shared_ptr<LentGeometry> lent;        // lazy: what the procedural reads while rays are traced
    std::vector<std::shared_ptr<void>> memory; // lazy: owns vertices and normals

    CurveLayout layout() const { return {output.curve_count, output.cvs_per_curve, output.offsets}; }
    // Floats of one attribute.
    size_t value_count(const MarramAttribute& attribute) const {
        return (attribute.rate == MARRAM_PER_CV ? layout().cv_count() : output.curve_count) *
               attribute.components;
    }
    std::vector<uint32_t> patches_made_early() const {
        if (lazy) return sample_patches;
        std::vector<uint32_t> all(patches.size());
        std::iota(all.begin(), all.end(), 0U);
        return all;
    }
};

// State of a build: its inputs, and what has been built so far.
struct Build {
    SceneGeometry& geometry;
    const BuildSettings& settings;
    const std::atomic<bool>& cancel;
    BuildProgress& progress;
    BuildStats& stats;
    KeptGeometry& kept; // from the previous frame
    World world{};      // meshes: growth surfaces until make_render_meshes(); no positions: not made yet
    std::vector<uint32_t> mesh_ids{};                              // [procedural], for those that make meshes
    std::vector<Procedural*> mesh_procedurals{};                   // [mesh ID], nullptr for the scene's
    std::vector<std::shared_ptr<RTCGeometryTy>> mesh_geometries{}; // [mesh ID], made on first use
    std::vector<char> reused_meshes{}; // [mesh ID], growth surfaces reused from the previous frame
    std::vector<std::shared_ptr<LentGeometry>>
        lent{};                      // to mesh procedurals, which may read it until the frame ends
    std::vector<CurveBuild> items{}; // in the order they were made
    // Those whose curves do not fit into memory: nothing is made from then on, only counted.
    std::vector<const Procedural*> refused{};
    uint64_t unmade_bytes = 0,
             bvh_bytes = 0; // of their arrays; of the BVHs of all curves, while they are built
    std::vector<std::shared_ptr<RTCGeometryTy>> curves{}; // own the buffers that World::curves points into

    double open() const { return settings.frame + settings.shutter_open; }
    double close() const { return settings.frame + settings.shutter_close; }
    std::vector<double> times(uint32_t keys) const { return motion_times(open(), close(), keys); }
    // True if the tolerance chooses the number of motion keys.
    bool chooses_keys() const { return settings.motion_keys == 0 && open() < close(); }

    // Throws the error that Embree has reported, if any, or Cancelled.
    void check_device() const {
        if (cancel.load()) throw Cancelled{};
        raise(*world.device_state);
    }
};

// ---- build.cpp

std::shared_ptr<RTCSceneTy> new_scene(const Build& build, RTCSceneFlags flags);
void commit(Build& build, RTCScene scene, const char* phase);
// Advances a procedural's simulation to the frame.
void prepare(Build& build, Procedural& procedural, const MarramFrame& frame);

// Moves a procedural's warnings to the build's statistics.
inline void take_warnings(BuildStats& stats, Procedural& procedural) {
    std::vector<Problem>& warnings = stats.warnings;
    for (Problem& warning : procedural.take_warnings()) // grooms that share a wind share its warnings
        if (std::ranges::find(warnings, warning) == warnings.end()) warnings.push_back(std::move(warning));
}

// ---- build_meshes.cpp

// Lists all meshes of the world, and makes those of the scene.
void place_meshes(Build& build);
// Makes the growth surface of one procedural.
void make_mesh(Build& build, Procedural& procedural, uint32_t id);
// What procedurals learn of the camera, whose arrays it points to.
MarramView view_of(const Build& build, const CameraSamples& camera);
// Replaces growth surfaces by the render meshes that procedurals make for the camera.
void make_render_meshes(Build& build);
// Embree's geometry of a mesh, made once.
RTCGeometry mesh_geometry(Build& build, uint32_t id);
// The committed scene of some meshes, made once; nullptr for none.
RTCScene collider_scene(Build& build, const std::vector<uint32_t>& ids);

struct PosedMesh {
    std::vector<Vec3f> positions, normals;
};
// A mesh of the world, by what lives as long as the world does.
struct MeshSource {
    uint32_t id = 0;
    Procedural* maker = nullptr;               // nullptr: the scene
    std::span<const Vec3f> positions, normals; // at the first key
    std::span<const std::array<uint32_t, 3>> triangles;
};
// A mesh at any time. Throws the error of the procedural that makes it.
PosedMesh pose_mesh(const SceneGeometry& geometry, const MeshSource& mesh, double frame, bool with_normals);

// ---- build_curves.cpp

// Adds a procedural's report and warnings to the statistics. wall: seconds that its curves took.
void take_report(BuildStats& stats, Procedural& procedural, double wall);
// Makes a patch of curves, at its place among all.
void tessellate_patch(const CurveBuild& item, uint32_t index);
// The distance from linear motion up to which a curve is traced with its first and last key.
inline double end_key_limit(const BuildSettings& settings) {
    return settings.tolerance / strand_motion_margin;
}
// Number of motion keys for the curves of a procedural.
uint32_t motion_keys_of_curves(Build& build, Procedural& procedural);
// Lets one procedural make its curves.
void make_curves(Build& build, Procedural& procedural, uint32_t keys);
// Attaches all curves to the world scene, in the scene's order.
void attach_curves(Build& build);

} // namespace marram
