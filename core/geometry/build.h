// SPDX-License-Identifier: Apache-2.0
// The build of a frame. Procedurals are made in the order of their dependencies: each is lent the geometry that it names, and the
// collider scene of the meshes that it traces, of which there is one for each distinct set. What makes meshes adds to them; what makes
// curves writes its CVs, patch by patch, straight into Embree's buffers. The world scene attaches the same mesh geometries again, or
// render meshes in their places, and the curves.
#pragma once

#include "core/geometry/kept_geometry.h"
#include "core/geometry/motion_keys.h"
#include "core/geometry/plugin_host.h"
#include "core/geometry/report.h"
#include "core/geometry/scene_curves.h"
#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"
#include "core/geometry/world.h"

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// What stays the same from frame to frame.
struct SceneGeometry {
    std::vector<SceneMesh> meshes;
    std::vector<std::unique_ptr<Procedural>> procedurals{}; // in the scene's order
    std::vector<SceneCurves> curves{};
    std::map<std::pair<std::string, uint64_t>, StateStore>
        states{};                                    // by procedural and the digest of what they depend on
    std::vector<MarramReportEntry> report_entries{}; // of all libraries, whether the scene uses them or not
};

// The camera that render meshes are made for, at instants of the shutter. Directions and ups are unit vectors at right angles.
struct CameraSamples {
    std::vector<double> times; // frames
    std::vector<Vec3d> positions, directions, ups;
    double fov = 1.0; // radians, vertical
    uint32_t width = 1, height = 1;
};

struct BuildSettings {
    double frame = 1.0, fps = 24.0;
    double shutter_open = 0.0, shutter_close = 0.0; // frames, relative to `frame`; open <= close
    uint32_t motion_keys =
        2; // 2 ... 64, used where open < close; 0: for each geometry as many as the tolerance asks for
    double bind_frame = 1.0;
    MarramStage stage = MARRAM_FINAL;
    double tolerance = 0.0; // metres
    View view;
    std::optional<CameraSamples> camera; // none: growth surfaces are what is seen
    std::vector<std::string> attributes; // of curves, by name; those a procedural does not have are left out
    bool curves_bvh = true;              // false: curves are made but not traced (baking)
    // Straight pieces that a segment is traced as; 0: the cubic; -1: as the tolerance allows (curve_pieces.h).
    int curve_pieces = -1;
    std::string state_folder; // where simulations keep their states; "": in memory, for this run
};

// Watched from other threads while build_world runs.
struct BuildProgress {
    std::atomic<const char*> phase{""};
    std::atomic<double> fraction{0.0}; // of the phase
};

struct BuildStats {
    // Wall seconds: of meshes that procedurals make; of the scene's meshes and collider scenes; of the BVH. Curves': see report.
    double terrain = 0.0, colliders = 0.0, curves_bvh = 0.0;
    Report report;            // of procedurals; curves' seconds are shared out among "seconds.<stage>"
    uint32_t motion_keys = 1; // the most that any geometry has; "fur.motion_keys" in `chosen` is one's own
    // Where the keys were chosen, of strands: what 99 in 100 are to stay below between keys, m (View::enlarged), and the share that
    // jumps within the shutter, which no number of keys follows; of the procedural where it is most.
    double motion_error = 0.0, motion_jumps = 0.0;
    double mesh_motion_error =
        0.0; // m likewise, of meshes that the shutter sees move, with the keys that there are
    // Where the tolerance has put what the scene leaves to it: "fur.cvs", by procedural and setting.
    std::map<std::string, double> chosen;
    uint64_t curves = 0, cvs = 0, segments = 0, triangles = 0;
    uint64_t curve_bytes = 0;     // buffers that Embree reads: vertices, normals, indices
    uint64_t attribute_bytes = 0; // of curves
    std::vector<std::string> warnings;
    std::vector<Box3f> patch_bounds; // as promised by the procedurals, in curve order
};

// Throws InputError (bad input, or a procedural that breaks the contract) and Cancelled. Runs in the caller's TBB arena. What rests is
// taken from `kept`, of another frame of the same geometry; the rest of it is freed on the way.
World build_world(SceneGeometry& geometry, const BuildSettings& settings, const std::atomic<bool>& cancel,
                  BuildProgress& progress, BuildStats& stats, KeptGeometry kept = {});

// The greatest number of motion keys that build_world would give curves with these settings.
uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress);

} // namespace marram
