// SPDX-License-Identifier: Apache-2.0
// Wind erosion of rock over levels of detail, coarse first. The page is in erosion.cpp.
#pragma once

#include "core/plugin/embree.h"
#include "procedural/erosion/grains.h"
#include "procedural/erosion/hardness.h"
#include "procedural/erosion/level_set.h"

#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace marram {

inline constexpr int most_erosion_levels = 6;

struct ErosionSettings {
    int stop_after = most_erosion_levels; // levels that are made: a coarse one is what a finer one shows
    int levels = 3;        // each has voxels of half the size of the one before; 1 to most_erosion_levels
    double voxel = 0.01;   // m, of the finest level
    double years = 1000.0; // of wind
    double detail = 0.75;  // depth of what a level adds, in voxels of the one before, 0 to 1
    int most_passes = 200; // of the first level
    HardnessSettings hardness;
};

// The first thing that is wrong: "levels: must be 1 to 6", or "".
std::string erosion_settings_fault(const ErosionSettings& settings);

// Metres a year that rock of hardness 1 loses at each vertex. `pass` counts all passes from 0. May throw.
using RockWear = std::function<void(const LevelMesh& mesh, uint64_t pass, std::span<double> rate)>;

struct ErosionHooks {
    std::function<bool()> cancelled;                                      // asked between the steps of a pass
    std::function<void(double share, const std::string& words)> progress; // share of the work, 0 to 1
};

struct ErosionLevel {
    LevelSet rock;
    int passes = 0;
    double start = 0.0, removed = 0.0; // m^3: rock before its first pass, and what its passes took
    double left = 0.0;                 // m^3 at its end
    size_t pieces = 0;                 // that came loose and were taken away
    double seconds = 0.0;
};

struct ErosionResult {
    std::vector<ErosionLevel> levels; // the coarsest first; fewer where it was cancelled
    double years = 0.0; // that passed; less than asked for where most_passes ended it, or no rock was left
    bool cancelled = false;
};

// Erodes a closed mesh. Throws LevelSetError for a mesh or voxels that cannot be used, std::invalid_argument for faulty settings.
ErosionResult erode(std::span<const float> positions, std::span<const uint32_t> triangles,
                    const ErosionSettings& settings, const RockWear& wear, const ErosionHooks& hooks = {});

// One of the winds that wear a rock in turn.
struct RockWind {
    GrainSettings grains; // its paths are those of a pass; its sand is that of RockScenery
    double share = 1.0;   // of the time
};

// What stands around a rock. Geometries are those of `device`, under the ids that they have in the host's scene.
struct RockScenery {
    RTCDevice device = nullptr;
    unsigned rock_id = 0;
    std::vector<std::pair<unsigned, RTCGeometry>> others = {};
    std::vector<unsigned> sand = {}; // ids of the others that are sand
    std::vector<RockWind> winds = {};
};

// The same wear in a scene that holds the rock: a mean over the winds, m a year.
GrainReport trace_winds(RTCScene scene, const WornMesh& rock, const RockScenery& scenery, uint64_t pass,
                        std::span<double> rate, const std::function<bool()>& cancelled = {});
// Wear by grains that are traced to a mesh of the rock, m a year. Each pass takes other random numbers. The report has sums over the winds.
GrainReport wear_by_grains(const RockScenery& scenery, const LevelMesh& mesh, uint64_t pass,
                           std::span<double> rate, const std::function<bool()>& cancelled = {});
// The same for erode(). Throws std::invalid_argument for faulty settings. `cancelled` may be empty.
RockWear grain_wear(RockScenery scenery, std::function<bool()> cancelled = {});

// Means of values at vertices over their neighbours on the surface, so that they blur as by a Gaussian whose standard deviation is
// about 0.6 sqrt(times) edges of the mesh.
void blur_over_surface(const LevelMesh& mesh, int times, std::span<double> values);

} // namespace marram
