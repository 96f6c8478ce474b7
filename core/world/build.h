// SPDX-License-Identifier: Apache-2.0
// Builds the world of one frame. Procedurals run in dependency order. Each gets the geometry that it names
// (curves: also all meshes that collide or shelter) and a collider scene of the meshes that it traces, shared
// by all that trace the same meshes. Procedurals of kind mesh add meshes. Procedurals of kind curves write
// their CVs, patch by patch, directly into Embree's buffers. The world scene holds the same mesh geometries
// (or the render meshes that replace them) and the curves.
#pragma once

#include "core/geometry/motion_keys.h"
#include "core/geometry/scene_curves.h"
#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"
#include "core/geometry/world.h"
#include "core/host/plugin_host.h"
#include "core/host/report.h"
#include "core/math/problem.h"
#include "core/world/kept_geometry.h"

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// Geometry inputs that all frames share.
struct SceneGeometry {
    std::vector<SceneMesh> meshes;
    std::vector<std::unique_ptr<Procedural>> procedurals{}; // in the scene's order
    std::vector<SceneCurves> curves{};
    std::map<std::pair<std::string, uint64_t>, StateStore>
        states{};                                    // key: name of the procedural, digest of its inputs
    std::vector<MarramReportEntry> report_entries{}; // of all libraries, used or not
};

// The camera that render meshes are made for, sampled at several times within the shutter. Directions and ups
// are orthogonal unit vectors.
struct CameraSamples {
    std::vector<double> times; // frames
    std::vector<Vec3d> positions, directions, ups;
    double fov = 1.0; // radians, vertical
    uint32_t width = 1, height = 1;
};

// Memory of the process.
struct MemoryBudget {
    uint64_t limit = 0;    // bytes that it may take, in all; 0: as many as there are
    uint64_t reserved = 0; // of these: what the caller takes once the world is built (the film)
};

enum class Lazy : uint8_t { never, always, automatic }; // lazy_choice.h

struct BuildSettings {
    double frame = 1.0, fps = 24.0;
    double shutter_open = 0.0, shutter_close = 0.0; // frames, relative to `frame`; open <= close
    uint32_t motion_keys = 2; // 2 ... 64, used if open < close; 0: the tolerance chooses for each geometry
    double bind_frame = 1.0;
    Vec2d shot_frames = Vec2d::Zero(); // first and last frame of the shot; equal: not known
    MarramStage stage = MARRAM_FINAL;
    // In metres, at view.reference_depth if that is not 0. 0: the default of each procedural (strands: a
    // thousandth of their length).
    double tolerance = 0.0;
    View view;
    std::optional<CameraSamples> camera; // none: all strands, and growth surfaces, are rendered
    bool render_meshes = true;           // for the camera; false: growth surfaces all the same
    std::vector<std::string> attributes; // of curves, by name; ignored if a procedural does not have them
    double share = 0.0; // of a preview: about this share of the curves, 0 ... 1; 0: all (MarramFrame.share)
    // Radii of curves of which only a share is made grow by this power of all / made. 1: they cover as much
    // as all, 0: they stay.
    double widening = 0.0;
    bool trace_curves = true; // false: curves are made but not traced (baking)
    MemoryBudget memory{};
    Lazy lazy = Lazy::never; // patches of curves are made when a ray meets them
    // Straight pieces per segment; 0: trace the cubic; -1: the tolerance chooses (curve_pieces.h).
    int curve_pieces = -1;
    std::string state_folder; // for the states of simulations; "": keep them in memory for this run
};

// Read by other threads while build_world runs.
struct BuildProgress {
    std::atomic<const char*> phase{""};
    std::atomic<double> fraction{0.0}; // of the phase
};

struct BuildStats {
    // Wall seconds.
    double procedural_meshes = 0.0; // made by procedurals of any type, and their render meshes
    double colliders = 0.0;         // the scene's meshes and collider scenes
    double choose_keys = 0.0;       // looking at the motion of some strands, to choose the motion keys
    double bvh = 0.0;               // attaching curves, their straight pieces, and the BVH of the world
    // What procedurals reported. The wall time of making curves is split over "seconds.<stage>" in proportion
    // to their thread seconds.
    Report report;
    uint32_t motion_keys = 1; // the most of any geometry; each one's own: "fur.motion_keys" in `chosen`
    // Only if keys were chosen automatically; of the procedural where it is largest. motion_error: 99th
    // percentile of the strands' error between keys, m, scaled by View::enlarged to its size at
    // reference_depth. motion_jumps: fraction of strands that jump within the shutter, which no number of
    // keys can follow. Curves traced with two keys (curve_parts.h) count with their largest error.
    double motion_error = 0.0, motion_jumps = 0.0;
    double mesh_motion_error = 0.0; // m, likewise, of meshes that move within the shutter, with the keys used
    // Settings that the tolerance chose, by procedural and setting, such as "fur.cvs".
    std::map<std::string, double> chosen;
    uint64_t curves = 0, cvs = 0, segments = 0, triangles = 0; // lazy ones too, built or not
    // Of lazy curves; known after tracing. rebuilt: how often patches were built that had been evicted.
    uint64_t patches = 0, built_patches = 0, rebuilt_patches = 0, evicted_patches = 0;
    double lazy_thread_seconds = 0.0;                 // of all threads, spent on these while rays were traced
    double lazy_merging = 0.0;                        // wall seconds, likewise
    uint64_t curve_bytes = 0;                         // vertices, normals, indices, primitives of parts
    uint64_t attribute_bytes = 0;                     // of curves
    uint64_t embree_bytes = 0, embree_peak_bytes = 0; // of Embree's device: after the build, and during it
    uint64_t volume_bytes = 0;                        // of velocities, all files of sequences
    std::vector<Problem> warnings;
    std::vector<Box3f> patch_bounds; // as declared by the procedurals, in curve order
};

// Throws InputError (bad input, or a procedural that breaks the contract) and Cancelled. Runs in the caller's
// TBB arena. `kept` comes from another frame of the same geometry: what has not changed is reused, the rest
// is freed.
World build_world(SceneGeometry& geometry, const BuildSettings& settings, const std::atomic<bool>& cancel,
                  BuildProgress& progress, BuildStats& stats, KeptGeometry kept = {});

// The largest number of motion keys that build_world would give curves with these settings.
uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress);

} // namespace marram
