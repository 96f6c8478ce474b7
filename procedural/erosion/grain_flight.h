// SPDX-License-Identifier: Apache-2.0
// Grains between two events, up to eight at a time: their start, their leaving of sand, and the arc to the next event.
// Shared by grains.cpp and grain_flight.cpp only. The model is documented in grains.cpp.
#pragma once

#include "core/math/simd.h"
#include "procedural/erosion/grain_tracer.h"

#include <array>
#include <cstdint>
#include <span>

namespace marram {

struct GrainState {
    Vec3d x, v;
};

enum class ArcEnd : uint8_t { goes_on, lands, leaves, gives_up };

// The test of an arc for empty space: a lane of Parabolas8 without t_clear.
struct GrainParabola {
    float x[3], v[3], a[3], t_max, min_step, clearance;
};

// A grain on an arc, which runs from one event to the next if nothing is hit. Between two arcs x, v and normal are those
// of the event: of a landing, before leave_sand().
struct Grain {
    Vec3d x, v, acceleration;                        // at the start of the arc
    Vec3d normal;                                    // of the surface that it leaves there, or zero
    double first_chord_time = 0.0, chord_time = 0.0; // duration of the first chord and of the others, s
    double end = 0.0;                                // of the arc, s after its start
    double chords = 0.0;                             // their number up to there
    GrainState end_state;
    GrainParabola parabola{};
    ArcEnd at_end = ArcEnd::goes_on;
    GrainSide side = GrainSide::downwind;  // by which it leaves
    uint32_t chord = 0;                    // the next one, and
    double chord_t0 = 0.0, chord_t1 = 0.0; // its ends while a ray traces it, s
    uint64_t path = 0;
    int64_t energy = 0; // quanta after the last event
    uint32_t hits = 0, landings = 0;
    uint64_t segments = 0; // chords of the arcs before, traced or not
};

using GrainBatch = std::span<Grain* const>; // one to eight

EventSeeds event_seeds(uint32_t seed, uint32_t event);

// Two random numbers for an event of a path: Sobol dimensions 0 and 1 at an index that is Owen-shuffled for each event.
std::array<double, 2> event_numbers(const GrainTracer& tracer, uint64_t path, uint32_t event);

// The paths of a block, in an order in which neighbours start near each other, so that they hit near each other:
// memory that one has read is then in the cache for the next.
std::vector<uint32_t> ordered_paths(const GrainTracer& tracer, uint64_t first, uint64_t end);

// Place and velocity at the start of grain.path, for each of a batch.
void emit_grains(const GrainTracer& tracer, GrainBatch grains);

// Replaces grain.v, with which grains land on sand with grain.normal, by the velocity of those that leave.
void leave_sand(const GrainTracer& tracer, GrainBatch grains);

// Begins arcs at grain.x with grain.v, from a surface with grain.normal; grain.segments limits them.
void start_arcs(const GrainTracer& tracer, GrainBatch grains);

// t: s after the start of the arc.
GrainState state_after(const GrainTracer& tracer, const Grain& grain, double t);

} // namespace marram
