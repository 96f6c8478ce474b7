// SPDX-License-Identifier: Apache-2.0
// Wear of rock by wind-blown sand: grains are traced through an Embree scene. The page of the model is in grains.cpp.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/embree.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>

namespace marram {

// A mesh of the scene that wears. All pointers are lent for the call; positions must be those that the scene was built with.
// `triangles` may name other vertices of the same positions than the scene's do: so vertices that stand twice become one.
struct WornMesh {
    unsigned geometry = 0;           // id in the scene
    const float* vertices = nullptr; // xyz packed, m
    size_t vertex_count = 0;
    const uint32_t* triangles = nullptr; // 3 a triangle, in the order of the scene's
    size_t triangle_count = 0;
};

struct GrainSettings {
    uint64_t paths = 1 << 20; // grains, 1 to 2^28
    uint32_t seed = 0;

    // The stream that enters. h: height above the ground.
    Vec3d wind = {1.0, 0.0,
                  0.0};        // where the air goes to; only its level direction counts. Zero: nothing moves
    double transport = 3e4;    // kg of sand a year and metre of width
    double height = 0.1;       // m over which the flux falls by e
    double speed = 10.0;       // m/s, high above the ground
    double bed_speed = 1.0;    // m/s, at the ground
    double speed_height = 0.4; // m over which the speed comes closer to `speed` by e
    double spread = 0.0;       // rad, greatest angle of the level direction to the wind

    // Flight.
    double gravity = 9.81;   // m/s^2, 0 or more
    double drag_time = 0.0;  // s in which a grain's velocity comes closer to the air's by e; 0: no drag
    double path_error = 0.0; // m between a path and its straight segments; 0: chosen by the scene

    // What grains hit.
    double energy_per_volume = 1e9; // J/m^3 that it takes to wear rock
    double threshold_speed = 1.0;   // m/s, head-on: slower grains wear nothing
    double angle_exponent = 2.0;    // n of E sin^n(angle); 2: energy normal to the surface, 0: all of it
    double normal_restitution = 0.6, tangent_restitution = 0.85; // speed after / before, 0 to 1
    double scatter = 0.3;      // 0 to 1: how far rebounds leave the mirror direction
    double settle_speed = 0.5; // m/s: slower grains stay where they are
    uint32_t most_hits = 32;   // on rock, 1 or more; a grain that has more is given up
    uint32_t most_segments = 4096;

    // Sand: what lands there is replaced by a grain of the stream.
    std::optional<double> ground;        // level sand everywhere at this height (y)
    std::span<const unsigned> sand = {}; // ids of meshes of sand

    // Grains travel the box of the scene, but not farther than this from the box of the worn meshes.
    double reach = infinity; // m
    unsigned ray_mask = 0xffffffffU;
};

// The first thing that is wrong with the settings: "height: must be above 0", or "".
std::string grain_settings_fault(const GrainSettings& settings);

// Energies are whole numbers of this many J per kg of sand, so that sums are exact.
inline constexpr double grain_quantum = 0x1p-20;

enum class GrainSide { upwind, downwind, left, right, above, below };

struct GrainReport {
    bool cancelled = false; // the wear is then zero
    // Grains: grains == left + settled + spent + given_up.
    uint64_t grains = 0;
    std::array<uint64_t, 6> left{}; // by GrainSide
    uint64_t settled = 0;           // rebounded slower than settle_speed
    uint64_t spent = 0;             // cannot reach the threshold again, however far they fall
    uint64_t given_up = 0;          // most_hits or most_segments
    // Hits: on worn meshes, on other meshes, on sand. grazes: met where the path leaves the surface; they do nothing.
    uint64_t worn_hits = 0, other_hits = 0, sand_hits = 0, grazes = 0;
    uint64_t rays = 0;
    // Energy in quanta: started + flight + sand == rock + ended. flight: by gravity and drag; sand: by exchange with sand.
    int64_t started = 0, flight = 0, sand = 0, rock = 0, ended = 0;
    int64_t worn = 0;            // quanta that wear rock, of those in `rock`; the sum over all triangles
    double mass_per_grain = 0.0; // kg a year that a grain stands for
    double volume = 0.0;         // m^3 of rock a year
    double seconds = 0.0;
    uint64_t ended_grains() const;
};

struct GrainHooks {
    std::function<bool()> cancelled; // asked often, from any thread
    // Every batch of rays before it is traced, from any thread: for measurements.
    std::function<void(std::span<const RTCRayHit>)> rays;
};

// Traces settings.paths grains. wear: metres of rock a year for each vertex, mesh after mesh; triangle_wear: the same for each
// triangle, or empty. The same bits for any number of threads. Throws std::invalid_argument for faulty settings or sizes.
GrainReport trace_grains(RTCScene scene, std::span<const WornMesh> meshes, const GrainSettings& settings,
                         std::span<double> wear, std::span<double> triangle_wear = {},
                         const GrainHooks& hooks = {});

// Wear by one kilogram of sand of specific energy `energy` (J/kg) that meets the surface at `sine` of its angle to it, times
// energy_per_volume: max(energy sine^n - threshold, 0), J/kg.
double wearing_energy(const GrainSettings& settings, double energy, double sine);

// Speed of the stream, and of the air that drags grains, at height h above the ground: m/s.
double stream_speed(const GrainSettings& settings, double h);

} // namespace marram
