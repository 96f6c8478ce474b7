// SPDX-License-Identifier: Apache-2.0
// The two-phase build of a frame: meshes and what makes meshes become the collider scene; what makes curves reads it,
// patch by patch, and writes its CVs straight into Embree's buffers; the world scene attaches the same colliders again
// and the curves.
#pragma once

#include "core/geometry/plugin_host.h"
#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"
#include "core/geometry/world.h"

#include <atomic>
#include <map>
#include <memory>
#include <span>
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
    uint32_t motion_keys = 2; // 2 ... 64, used where open < close; 0: as many as the tolerance asks for
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
    uint32_t motion_keys = 1;                    // that the world has
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

// The number of motion keys that build_world would give these settings.
uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress);

// The smallest number of motion keys, 2 ... 64, at which every mesh, drawn along straight lines between its
// keys, stays within `tolerance` metres, enlarged by the view, of where it belongs at any instant of the shutter (64
// where even those do not do).
uint32_t motion_keys_for(const SceneGeometry& geometry, double tolerance, const View& view, double open,
                         double close);

// How far meshes are from where they belong, m, enlarged, with so many motion keys: of the corners of their boxes, and of some thousand
// vertices each where the view enlarges or they deform.
double mesh_motion_error(const SceneGeometry& geometry, const View& view, uint32_t keys, double open,
                         double close);

// How far strands leave the straight lines between motion keys, from their CVs at five instants of the shutter.
class StrandMotion {
  public:
    // A strand's CVs: samples[i] holds x, y, z and one more float for each. Their distances are kept enlarged by the view.
    void add(const float* const samples[5], size_t cvs, const View& view);
    void add(const StrandMotion& other);

    // What 99 strands in 100 stay below with so many keys, metres: as measured for 2 and 3, beyond that it falls with the square of
    // their number less one. Strands that jump are left out: those that two keys do not hold to the tolerance and three hardly
    // better.
    double left(uint32_t keys, double tolerance) const;
    double jumps(double tolerance) const; // their share
    // The smallest number of keys, 2 ... 64, that leaves no more than the tolerance.
    uint32_t keys_for(double tolerance) const;

  private:
    struct Gap {
        float two, three; // of one strand with so many keys
    };
    static bool jumps(const Gap& gap, double tolerance);
    std::vector<Gap> gaps_;
};

// Motion sample times in frames: `keys` equally spaced over the shutter, both ends exact; one where it is closed.
std::vector<double> motion_times(const BuildSettings& settings, uint32_t keys);

} // namespace marram
