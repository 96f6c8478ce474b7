// SPDX-License-Identifier: Apache-2.0
// The state of a trace of grains. Internal to the tracer.
#pragma once

#include "procedural/erosion/empty_space.h"
#include "procedural/erosion/grains.h"

#include <vector>

namespace marram {

inline constexpr double grain_step = 0x1p-23;       // U: relative precision of float coordinates
inline constexpr double max_grain_coordinate = 1e8; // m
inline constexpr double longest_arc = 1e6;          // s
inline constexpr int grain_profile = 256; // positions along the start plane where the ground is sampled

// The box in which grains are traced, in the frame of the wind: s along it, y up, t across it (to the right).
struct GrainBox {
    Vec3d along = Vec3d::UnitX(), across = Vec3d::UnitZ();
    double s0 = 0.0, s1 = 0.0, t0 = 0.0, t1 = 0.0, y0 = 0.0, y1 = 0.0;
    double start = 0.0;         // s of the start plane
    double base = 0.0;          // height of the ground where no mesh is below the start plane
    double top = 0.0;           // maximum start height above the ground
    double size = 0.0;          // diagonal
    std::vector<double> ground; // y along the start plane from t0 to t1
};

struct GrainMesh {
    WornMesh mesh;
    size_t first_vertex = 0, first_triangle = 0;
};

struct EventSeeds { // of the random numbers of an event
    uint32_t order = 0, scrambling[2] = {0, 0};
};

struct GrainTracer {
    RTCScene scene = nullptr;
    GrainSettings settings;
    GrainHooks hooks;
    std::vector<GrainMesh> meshes; // sorted by id
    std::vector<unsigned> sand;    // sorted
    GrainBox box;
    EmptySpace empty;
    double chord_time = 0.0; // of chords without drag, s
    double sag = 0.0, threshold = 0.0, settle = 0.0, launch = 0.0; // launch: sqrt(g H)
    double share = 0.0;                                            // of the stream that starts below box.top
    std::array<uint32_t, 5> shifts{};         // scrambling seeds of the dimensions of a start
    std::array<EventSeeds, 64> event_seeds{}; // of the first events
    std::vector<int64_t> vertex_quanta, triangle_quanta;
};

// Throws std::invalid_argument for arrays of the wrong size.
void take_worn_meshes(GrainTracer& tracer, std::span<const WornMesh> meshes, size_t wear,
                      size_t triangle_wear);

// false: there is nothing to wear, or no wind.
bool find_grain_box(GrainTracer& tracer);

// After find_grain_box().
void find_empty_space(GrainTracer& tracer);

// Converts quanta to depths, metres a year.
void write_wear(const GrainTracer& tracer, double volume_per_quantum, std::span<double> wear,
                std::span<double> triangle_wear);

} // namespace marram
