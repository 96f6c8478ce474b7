// SPDX-License-Identifier: Apache-2.0
// Wear of rock by wind-blown sand: grains are traced through an Embree scene. The model is documented in
// grains.cpp.
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

// A mesh of the scene that wears. Pointers must be valid during the call; positions must be those of the
// scene. `triangles` may use other vertex indices than the scene for equal positions, to merge duplicate
// vertices.
struct WornMesh {
    unsigned geometry = 0;           // id in the scene
    const float* vertices = nullptr; // xyz packed, m
    size_t vertex_count = 0;
    const uint32_t* triangles = nullptr; // 3 per triangle, in the order of the scene
    size_t triangle_count = 0;
    // In the scene each two triangles a b c and a c d are one of Embree's quads, d a b c. Must agree with the
    // scene: otherwise other triangles wear than those that are hit.
    bool quads = false;
};

// A scene's defaults are in rock_declaration.cpp; these initial values are for callers that set a few.
struct GrainSettings {
    uint64_t paths = 1 << 20; // number of grains, 1 to 2^28
    uint32_t seed = 0;

    // The incoming stream. h: height above the ground.
    Vec3d wind = {1.0, 0.0, 0.0}; // heading; only the horizontal direction is used. Zero: no grains
    double transport = 3e4;       // kg of sand per year and metre of width
    double height = 0.1;          // m over which the flux falls by a factor e
    double speed = 10.0;          // m/s, limit high above the ground
    double bed_speed = 1.0;       // m/s, at the ground
    double speed_height = 0.4;    // m over which the difference to `speed` falls by a factor e
    double spread = 0.0;          // rad, largest horizontal angle to the wind

    // Flight.
    double gravity = 9.81;   // m/s^2, 0 or more
    double drag_time = 0.0;  // s in which the velocity difference to the air falls by a factor e; 0: no drag
    double path_error = 0.0; // m, sagitta between path and segments; 0: from the scene

    // Hits.
    double energy_per_volume = 1e9; // J/m^3 needed to wear rock
    double threshold_speed = 1.0;   // m/s, at normal incidence: slower grains cause no wear
    double angle_exponent = 2.0;    // n in E sin^n(angle); 2: energy normal to the surface, 0: total energy
    double normal_restitution = 0.6, tangent_restitution = 0.85; // speed after / before, 0 to 1
    double scatter = 0.3;            // 0 to 1: deviation of rebounds from specular reflection
    double settle_speed = 0.5;       // m/s: slower grains come to rest
    uint32_t max_hits = 32;          // hits except on sand, 1 or more; then the grain is terminated
    uint32_t max_segments = 1 << 16; // chords of its path, traced or not; then the grain is terminated

    // Sand: a grain that lands there is replaced by a new grain of the stream.
    std::optional<double> ground;        // level sand everywhere at this height y
    std::span<const unsigned> sand = {}; // ids of meshes of sand

    // Grains are traced in the bounds of the scene, at most this far from the bounds of the worn meshes.
    double reach = infinity; // m
    unsigned ray_mask = 0xffffffffU;
};

// The first error in the settings, e.g. "scatter: must be 0 to 1", or "".
std::string grain_settings_fault(const GrainSettings& settings);

// Energies are integer multiples of this, in J per kg of sand, so that sums are exact.
inline constexpr double grain_quantum = 0x1p-20;

enum class GrainSide { upwind, downwind, left, right, above, below };

struct GrainReport {
    bool cancelled = false; // the wear is then zero
    // Number of grains: grains == left + settled + spent + given_up.
    uint64_t grains = 0;
    std::array<uint64_t, 6> left{}; // left the box, by GrainSide
    uint64_t settled = 0;           // rebounded slower than settle_speed
    uint64_t spent = 0;             // cannot reach the threshold again, even by falling
    uint64_t given_up = 0;          // reached max_hits or max_segments, or is too far from the origin
    // Hits: on worn meshes, on other meshes, on sand. grazes: the path leaves the surface at the hit, which
    // has no effect.
    uint64_t worn_hits = 0, other_hits = 0, sand_hits = 0, grazes = 0;
    uint64_t rays = 0;
    // Energy in quanta: started + flight + sand == rock + ended. flight: gained by gravity and drag; sand:
    // gained on sand.
    int64_t started = 0, flight = 0, sand = 0, rock = 0, ended = 0;
    int64_t worn = 0;            // sum of wearing_energy() over all triangles, in quanta; may exceed `rock`
    double mass_per_grain = 0.0; // kg a year that one grain represents
    double volume = 0.0;         // m^3 of rock per year
    double seconds = 0.0;
    uint64_t ended_grains() const;
};

struct GrainHooks {
    std::function<bool()> cancelled; // polled often, from any thread
    // Receives every batch of rays before it is traced, from any thread: for measurements. Then every chord
    // is traced.
    std::function<void(std::span<const RTCRayHit>)> rays;
};

// The scene has meshes (triangles, quads, grids), user geometries and instances of them. Embree's point queries do not
// see curves, points and subdivision surfaces: grains would fly through them.
// Traces settings.paths grains. wear: metres of rock a year for each vertex, concatenated over the meshes;
// triangle_wear: the same for each triangle, or empty. Bitwise the same for any number of threads. Throws
// std::invalid_argument for invalid settings or sizes.
GrainReport trace_grains(RTCScene scene, std::span<const WornMesh> meshes, const GrainSettings& settings,
                         std::span<double> wear, std::span<double> triangle_wear = {},
                         const GrainHooks& hooks = {});

// Wear by one kilogram of sand, times energy_per_volume: max(energy sine^n - threshold, 0), J/kg. `energy` is
// the specific energy (J/kg), `sine` that of the angle between path and surface.
double wearing_energy(const GrainSettings& settings, double energy, double sine);

} // namespace marram
