// SPDX-License-Identifier: Apache-2.0
// The two-phase build of a frame: meshes and what makes meshes become the collider scene; what makes curves reads it,
// patch by patch, and writes its CVs straight into Embree's buffers; the world scene attaches the same colliders again
// and the curves.
#pragma once

#include "core/geometry/motion_keys.h"
#include "core/geometry/plugin_host.h"
#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"
#include "core/geometry/world.h"

#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// What stays the same from frame to frame.
struct SceneGeometry {
    std::vector<SceneMesh> meshes;
    std::vector<std::unique_ptr<Procedural>> procedurals; // in the scene's order
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
    std::vector<std::string> attributes; // of curves, by name; those a procedural does not have are left out
    bool curves_bvh = true;              // false: curves are made but not traced (baking)
    // Straight pieces that a segment is traced as; 0: the cubic; -1: as the tolerance allows (curve_pieces.h).
    int curve_pieces = -1;
};

// Watched from other threads while build_world runs.
struct BuildProgress {
    std::atomic<const char*> phase{""};
    std::atomic<double> fraction{0.0}; // of the phase
};

struct BuildStats {
    double colliders = 0.0, curves_bvh = 0.0; // wall seconds
    // The tessellation's wall seconds, shared out among the stages of all procedurals.
    double expand = 0.0, gusts = 0.0, shield = 0.0, bend = 0.0, jiggle = 0.0, collide = 0.0;
    uint64_t contacts = 0, pushed_out = 0, unresolved = 0, skipped_pushes = 0, dips = 0; // of collision
    double goal_angle = 0.0, turned_angle = 0.0; // radians that segments were to turn, and did
    double collision_reached = 1.0;              // turned / goal: share of the way to the goal
    uint32_t motion_keys = 1; // the most that any geometry has; "fur.motion_keys" in `chosen` is one's own
    // Where the keys were chosen, of strands: what 99 in 100 are to stay below between keys, m (View::enlarged), and the share that
    // jumps within the shutter, which no number of keys follows; of the procedural where it is most.
    double motion_error = 0.0, motion_jumps = 0.0;
    double mesh_motion_error =
        0.0; // m likewise, of meshes that the shutter sees move, with the keys that there are
    // Where the tolerance has put dials that the scene leaves to it: "fur.cvs", by procedural and dial.
    std::map<std::string, double> chosen;
    uint64_t curves = 0, cvs = 0, segments = 0, triangles = 0;
    uint64_t curve_bytes = 0;       // buffers that Embree reads: vertices, normals, indices
    uint64_t curve_extra_bytes = 0; // ours besides: roots, scratch, attributes
    std::vector<std::string> warnings;
    std::vector<Box3f> patch_bounds; // as promised by the procedurals, in curve order
};

// Throws InputError (bad input, or a procedural that breaks the contract) and Cancelled. Runs in the caller's TBB arena.
World build_world(SceneGeometry& geometry, const BuildSettings& settings, const std::atomic<bool>& cancel,
                  BuildProgress& progress, BuildStats& stats);

// The greatest number of motion keys that build_world would give curves with these settings.
uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress);

} // namespace marram
