// SPDX-License-Identifier: Apache-2.0
// What grains.cpp and grain_setup.cpp share, and nobody else: a trace, ready to run.
#pragma once

#include "procedural/erosion/grains.h"

#include <vector>

namespace marram {

inline constexpr double grain_step = 0x1p-23; // U: of float coordinates
inline constexpr double grain_farthest = 1e8; // m
inline constexpr int grain_profile = 256;     // places along the plane whose ground is looked up

// The box that grains travel, in the frame of the wind: s along it, y up, t across it (to the right).
struct GrainBox {
    Vec3d along = Vec3d::UnitX(), across = Vec3d::UnitZ();
    double s0 = 0.0, s1 = 0.0, t0 = 0.0, t1 = 0.0, y0 = 0.0, y1 = 0.0;
    double start = 0.0;         // s of the plane
    double base = 0.0;          // ground where no mesh is below the plane
    double top = 0.0;           // greatest height above the ground at which grains start
    double size = 0.0;          // diagonal
    double lead = 0.0;          // greatest level length of the path
    std::vector<double> ground; // y along the plane from t0 to t1
};

struct GrainMesh {
    WornMesh mesh;
    size_t first_vertex = 0, first_triangle = 0;
};

struct GrainTracer {
    RTCScene scene = nullptr;
    GrainSettings settings;
    GrainHooks hooks;
    std::vector<GrainMesh> meshes; // ascending ids
    std::vector<unsigned> sand;    // ascending
    GrainBox box;
    double sag = 0.0, threshold = 0.0, settle = 0.0, launch = 0.0; // launch: sqrt(g H)
    std::array<uint32_t, 5> shifts{};                              // seeds of the dimensions of a start
    std::vector<int64_t> vertex_quanta, triangle_quanta;
};

// Throws std::invalid_argument for arrays that do not fit.
void take_worn_meshes(GrainTracer& tracer, std::span<const WornMesh> meshes, size_t wear,
                      size_t triangle_wear);

// false: nothing that wears, or nothing that blows.
bool find_grain_box(GrainTracer& tracer);

// Quanta become depths: metres a year.
void write_wear(const GrainTracer& tracer, double volume_per_quantum, std::span<double> wear,
                std::span<double> triangle_wear);

} // namespace marram
