// SPDX-License-Identifier: Apache-2.0
// Wind erosion of rock in levels of detail, coarse first. The model is documented in erosion.cpp.
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

inline constexpr int max_erosion_levels = 6;

// A scene's defaults are in rock_declaration.cpp; these initial values are for callers that set a few.
struct ErosionSettings {
    int stop_after = max_erosion_levels; // levels to compute; a coarse level previews the finer ones
    int levels = 3;                      // each halves the voxel size; 1 to max_erosion_levels
    double voxel = 0.01;                 // m, of the finest level
    double years = 1000.0;               // duration of the wind
    double detail = 0.75;                // depth of the added detail, 0 to 1 voxels of the level before
    int max_passes = 200;                // limit for the first level
    HardnessSettings hardness;
};

// The first error in the settings, e.g. "levels: must be 1 to 6", or "".
std::string erosion_settings_fault(const ErosionSettings& settings);

// Computes the wear rate of rock of hardness 1 at each vertex, metres a year. `pass` counts all passes from
// 0. May throw.
using RockWear = std::function<void(const LevelMesh& mesh, uint64_t pass, std::span<double> rate)>;

struct ErosionHooks {
    std::function<bool()> cancelled; // polled between the steps of a pass
    std::function<void(double share, const std::string& words)> progress; // fraction of the work, 0 to 1
};

struct ErosionLevel {
    LevelSet rock;
    int passes = 0;
    double start = 0.0, removed = 0.0; // m^3: volume before the first pass; removed by passes
    double left = 0.0;                 // m^3 at the end of the level
    size_t pieces = 0;                 // detached pieces that were removed
    double seconds = 0.0;
};

struct ErosionResult {
    std::vector<ErosionLevel> levels; // coarsest first; fewer if cancelled
    double years = 0.0; // simulated; fewer than settings.years if max_passes ended it or no rock was left
    double given = 0.0; // m^3: the rock before any wear, in voxels of the last level; 0 if cancelled
    bool cancelled = false;
};

// Erodes a closed mesh. Throws LevelSetError for an unusable mesh or voxel size, std::invalid_argument for
// invalid settings.
ErosionResult erode(std::span<const float> positions, std::span<const uint32_t> triangles,
                    const ErosionSettings& settings, const RockWear& wear, const ErosionHooks& hooks = {});

// One of the winds that wear a rock.
struct RockWind {
    GrainSettings grains; // paths per pass; grains.sand is replaced by RockScenery::sand
    double share = 1.0;   // weight: relative duration
};

// Surroundings of a rock. Geometries belong to `device` and have the ids of the host's scene.
struct RockScenery {
    RTCDevice device = nullptr;
    unsigned rock_id = 0;
    std::vector<std::pair<unsigned, RTCGeometry>> others = {};
    std::vector<unsigned> sand = {}; // ids of those in `others` that are sand
    std::vector<RockWind> winds = {};
};

// Wear of a rock in a scene that contains it: mean over the winds, m a year.
GrainReport trace_winds(RTCScene scene, const WornMesh& rock, const RockScenery& scenery, uint64_t pass,
                        std::span<double> rate, const std::function<bool()>& cancelled = {});
// Wear of a mesh of the rock by traced grains, m a year. Random numbers differ between passes. The report
// sums over the winds.
GrainReport wear_by_grains(const RockScenery& scenery, const LevelMesh& mesh, uint64_t pass,
                           std::span<double> rate, const std::function<bool()>& cancelled = {});
// wear_by_grains() as a callback for erode(). Throws std::invalid_argument for invalid settings. `cancelled`
// may be empty.
RockWear grain_wear(RockScenery scenery, std::function<bool()> cancelled = {});

// Blurs values at vertices over the surface, approximately by a Gaussian with a standard deviation of 0.6
// sqrt(times) edge lengths of the mesh.
void blur_over_surface(const LevelMesh& mesh, int times, std::span<double> values);

} // namespace marram
