// SPDX-License-Identifier: Apache-2.0
// Grains between two events, up to eight at a time: their start, their leaving of sand, the arc to the next event, and rays
// along it. Internal to the tracer of grains. The model is documented in grains.cpp.
#pragma once

#include "core/math/simd.h"
#include "procedural/erosion/grain_tracer.h"

#include <array>
#include <cstdint>
#include <span>

namespace marram {

enum class ArcEnd : uint8_t { goes_on, lands, leaves, gives_up };

// Of an arc that hits nothing.
struct GrainArcEnd {
    Vec3d x;
    double time = 0.0; // s after the start
    Vec3d v;
    double chords = 0.0; // their number up to there
    ArcEnd how = ArcEnd::goes_on;
    GrainSide side = GrainSide::downwind; // by which it leaves
};

// The test of an arc for empty space: a lane of Parabolas8 without t_clear and gravity.
struct GrainParabola {
    float x[3], v[3], t_max, min_step, clearance;
};

// A grain on an arc, which runs from one event to the next if nothing is hit. Between two arcs x, v and normal are those
// of the event: of a landing, before leave_sand(). load_four() reads vectors together with the number behind them.
struct Grain {
    Vec3d x; // at the start of the arc
    double first_chord_time = 0.0;
    Vec3d v;
    double chord_time = 0.0;  // duration of the other chords, s
    Vec3d normal;             // of the surface that it leaves, or zero
    double chords_left = 0.0; // of this arc and all later ones, traced or not
    GrainArcEnd end;
    GrainParabola parabola{};
    Vec3d acceleration;
    double chord_t0 = 0.0, chord_t1 = 0.0; // ends of the chord that a ray traces, s
    uint32_t chord = 0;                    // that, or the next
    float t_clear = 0.0F;                  // nothing is hit before, s
    uint32_t path = 0;
    int64_t energy = 0; // quanta after the last event
    uint32_t hits = 0, landings = 0;
};

using GrainBatch = std::span<Grain* const>; // one to eight

// Grains side by side, a grain a lane.
struct alignas(64) Grains8 {
    Wide3d x, v, normal;
    VDouble chords_left;
    // The arc:
    Wide3d acceleration, end_x, end_v;
    VDouble first_chord_time, chord_time, end, chords;
    VLong at_end, side;
    Parabolas8 parabolas;

    Vec3d velocity(int lane) const;
    GrainArcEnd arc_end(int lane) const;
    void store_arc(int lane, Grain& to) const; // t_clear too
};

EventSeeds event_seeds(uint32_t seed, uint32_t event);

// The paths of a block, in an order in which neighbours start near each other, so that they hit near each other:
// memory that one has read is then in the cache for the next.
std::vector<uint32_t> ordered_paths(const GrainTracer& tracer, uint64_t first, uint64_t end);

// The state of a batch between two arcs. Lanes without a grain repeat the first.
void load_grains(GrainBatch from, Grains8& to);

// The state at the start of the paths of a batch.
void emit_grains(const GrainTracer& tracer, GrainBatch grains, Grains8& to);

// Replaces the velocities with which grains land on sand by those of the grains that leave.
void leave_sand(const GrainTracer& tracer, GrainBatch grains, Grains8& g);

// Begins arcs at x with v, from surfaces with `normal`, and takes the first step through empty space. Returns bits of the
// arcs that are then at their end, or near something.
uint32_t start_arcs(const GrainTracer& tracer, Grains8& g);

// Sets `chord` and its ends to the chord that contains grain.t_clear, and rays along them. Returns bits of grains whose ray
// is not valid: they are too far from the origin, or the chord is too long.
uint32_t set_rays(const GrainTracer& tracer, GrainBatch grains, std::span<RTCRayHit> rays);

} // namespace marram
