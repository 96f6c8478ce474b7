// SPDX-License-Identifier: Apache-2.0
// Grains between two events, up to sixteen at a time: their start, their leaving of sand, the arc to the next
// event, and rays along it. Internal to the tracer of grains. The model is documented in grains.cpp.
#pragma once

#include "core/math/simd.h"
#include "procedural/erosion/grain_tracer.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace marram {

enum class ArcEnd : uint8_t { goes_on, lands, leaves, gives_up };

// What is to be done with a grain next: start an arc, leave the sand on which it has landed, follow its arc
// through empty space, trace a ray along it, end its flight (it has left the box or gives up). none: it has
// ended.
enum class Next : uint8_t { start_arc, leave_sand, fly, trace_ray, end_flight, none };
inline constexpr size_t next_count = size_t(Next::none) + 1;

// The state at the end of an arc: where it leads if it hits nothing, then where it has hit.
struct GrainArcEnd {
    Vec3d x;
    double time = 0.0; // s after the start
    Vec3d v;
    double chords = 0.0; // their number up to there
    ArcEnd how = ArcEnd::goes_on;
    GrainSide side = GrainSide::downwind; // by which it leaves
};

// The test of an arc for empty space: a lane of Parabolas8 (gravity is that of the trace). Its first eight
// floats are read and written together.
struct GrainParabola {
    float x[3], v[3], t_max, min_step;
    float clearance, t_clear; // nothing is hit before t_clear
    int32_t after;            // the Next at its end
};
static_assert(offsetof(GrainParabola, min_step) == 7 * sizeof(float));

// A grain on an arc, which runs from one event to the next, at `end` if nothing is hit. A hit sets `end` and
// `normal` to its own. The next arc begins there, with chords_left - end.chords. The order of members
// matters: load_four() and store_four() move a vector and the double that follows it together.
struct Grain {
    Vec3d x; // at the start of the arc
    double first_chord_time = 0.0;
    Vec3d v;
    double chord_time = 0.0;  // duration of the other chords, s
    Vec3d normal;             // of the surface at the end, or zero
    double chords_left = 0.0; // of this arc and all later ones, traced or not
    GrainArcEnd end;
    Vec3d acceleration;                    // set if there is drag
    double chord_t0 = 0.0, chord_t1 = 0.0; // ends of the chord that a ray traces, s
    uint32_t chord = 0;                    // its number, or that of the next; 0: the first one
    uint32_t path = 0;
    int64_t energy = 0; // quanta after the last event
    uint32_t hits = 0, landings = 0;
    alignas(32) GrainParabola parabola{};
};

inline constexpr size_t grains_at_once = 2 * lanes;
using GrainBatch = std::span<Grain* const>; // one to sixteen

// Grains side by side, a grain a lane.
struct alignas(64) Grains8 {
    Wide3d x, v, normal; // normal: of the surface that they leave
    VDouble chords_left;
    // The arc:
    Wide3d acceleration, end_x, end_v;
    VDouble first_chord_time, chord_time, end, chords;
    VLong at_end, side;
};

// Two at a time, as of parabolas.
struct Grains16 {
    std::array<Grains8, 2> half;
    ParabolaPair parabolas;

    Vec3d velocity(size_t k) const;
};

using NextOfGrains = std::array<Next, grains_at_once>;

EventSeeds event_seeds(uint32_t seed, uint32_t event);

// The paths of a block, in an order in which neighbours start near each other, so that they hit near each
// other: memory that one has read is then in the cache for the next.
std::vector<uint32_t> ordered_paths(const GrainTracer& tracer, uint64_t first, uint64_t end);

// The state of a batch at the ends of its arcs. Lanes without a grain repeat the first.
void load_grains(GrainBatch from, Grains16& to);

// The state at the start of the paths of a batch.
void emit_grains(const GrainTracer& tracer, GrainBatch grains, Grains16& to);

// Replaces the velocities with which grains land on sand by those of the grains that leave.
void leave_sand(const GrainTracer& tracer, GrainBatch grains, Grains16& g);

// Begins arcs at x with v, from surfaces with `normal`, and follows them as follow_arcs() does.
void start_arcs(const GrainTracer& tracer, GrainBatch grains, Grains16& g, NextOfGrains& next);

// Follows arcs by a few steps through empty space.
void follow_arcs(const GrainTracer& tracer, GrainBatch grains, NextOfGrains& next);

// Of up to eight grains. Sets `chord` and its ends to the chord that contains t_clear, and rays along them.
// Returns bits of grains whose ray is not valid: they are too far from the origin, or the chord is too long.
uint32_t set_rays(const GrainTracer& tracer, GrainBatch grains, std::span<RTCRayHit> rays);

} // namespace marram
