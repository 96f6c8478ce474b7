// SPDX-License-Identifier: Apache-2.0
// Eight grains are computed side by side, a grain a lane: with level sand around a rock a grain starts six
// arcs, most of them from sand. The grains themselves are structs that are read from and written to lanes, as
// eight neighbours rarely meet the next event together. Two times eight are one batch: nothing of the second
// eight waits for the first, so a processor computes them at the same time. What comes next for a grain is
// found without a branch, as it cannot be predicted.
#include "procedural/erosion/grain_flight.h"

#include "core/math/hash.h"
#include "procedural/erosion/grain_lanes.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr uint32_t start_places = 32; // in each direction of the start plane, for the order of grains
constexpr double max_chords = 0x1p40;
constexpr int steps_at_once = 2; // through empty space, in a batch

struct alignas(64) Starts8 {
    VUint numbers[5]; // points of the Sobol sequence before they are scrambled
    VDouble across;   // 0 to 1
};

struct alignas(64) Rays8 {
    VDouble chord, t_clear; // chord: the next one
    VDouble t0, t1;         // of the chord that the ray traces
    Wide3f origin, direction;
    VFloat tfar;
    VLong fails;
};

// ---- random numbers ----

// sqrt(-2 ln(1 - u)): 1 - u is exact, as u is a multiple of 2^-32.
MARRAM_INLINE VDouble rayleigh(const VDouble& u) { return vsqrt(-2.0 * vlog(1.0 - u)); }

// -ln(1 - x), 0 <= x < 1: inverts the distribution 1 - e^-h. Error < 1e-14 relative: near 0 by the series of
// atanh.
MARRAM_INLINE VDouble exponential_quantile(const VDouble& x) {
    const VDouble z = x / (2.0 - x), w = z * z;
    VDouble p = splat(1.0 / 11.0);
    p = p * w + 1.0 / 9.0;
    p = p * w + 1.0 / 7.0;
    p = p * w + 1.0 / 5.0;
    p = p * w + 1.0 / 3.0;
    return select(x < 0.1, 2.0 * z + 2.0 * z * w * p, -vlog(1.0 - x));
}

double grain_unit(const GrainTracer& tracer, uint64_t path, int dimension) {
    return sobol_point(uint32_t(path), dimension, tracer.shifts[size_t(dimension)]);
}

// ---- the stream ----

MARRAM_INLINE VDouble stream_speeds(const GrainSettings& s, const VDouble& h) {
    return s.bed_speed + (s.speed - s.bed_speed) * (1.0 - vexp(-vmin(h * (1.0 / s.speed_height), 700.0)));
}

// g.x.y is relative to the ground.
MARRAM_HOT void find_starts(const GrainTracer& tracer, Starts8& starts, Grains8& g) {
    const GrainSettings& s = tracer.settings;
    const GrainBox& box = tracer.box;
    VDouble u[5];
    for (int d = 0; d < 5; ++d)
        u[d] = unit_numbers(owen_shuffle(starts.numbers[d], tracer.shifts[size_t(d)]));
    starts.across = u[0];
    const VDouble h = vmin(s.height * exponential_quantile(tracer.share * u[1]), box.top);
    VDouble sine, cosine;
    sincos(2.0 * pi * u[3], sine, cosine);
    const VDouble rise = tracer.launch * rayleigh(u[2]) * cosine;
    sincos_half_pi(s.spread * (2.0 * u[4] - 1.0), sine, cosine);
    const VDouble t = box.t0 + u[0] * (box.t1 - box.t0), speed = stream_speeds(s, h);
    g.x.x = box.start * box.along.x() + t * box.across.x();
    g.x.y = h;
    g.x.z = box.start * box.along.z() + t * box.across.z();
    g.v.x = speed * (cosine * box.along.x() + sine * box.across.x());
    g.v.y = rise;
    g.v.z = speed * (cosine * box.along.z() + sine * box.across.z());
    g.normal = {splat(0.0), splat(0.0), splat(0.0)};
    g.chords_left = splat(double(s.max_segments));
}

// The velocities of the grains that leave sand instead of those that land.
MARRAM_INLINE void find_ejections(const GrainTracer& tracer, const EventKeys8& keys, const VLong& has_hit,
                                  Grains8& g) {
    const GrainBox& box = tracer.box;
    VDouble u0, u1;
    event_numbers(keys, u0, u1);
    const VDouble rise = tracer.launch * rayleigh(u0);
    VDouble sine, cosine;
    sincos_half_pi(tracer.settings.spread * (2.0 * u1 - 1.0), sine, cosine);
    const Wide3d level = {cosine * box.along.x() + sine * box.across.x(), splat(0.0),
                          cosine * box.along.z() + sine * box.across.z()};
    const Wide3d along = level - g.normal * dot(level, g.normal);
    VDouble per_length = splat(tracer.settings.bed_speed);
    if (const VLong sloping = g.normal.y != 1.0; any(sloping)) {
        const VDouble along_length = length(along);
        const VDouble sloped = select(along_length > 1e-6, tracer.settings.bed_speed / along_length, 0.0);
        per_length = select(sloping, sloped, per_length);
    }
    const Wide3d out = g.normal * rise + along * per_length;
    const VDouble limit = dot(g.v, g.v), speed = dot(out, out); // squares
    g.v = out;
    if (const VLong limited = has_hit & (speed > limit); any(limited))
        g.v = out * select(limited, vsqrt(limit / speed), 1.0);
}

// ---- arcs ----

// The time at which q + v t - g t^2 / 2 falls to `low`, g >= 0. For q < low: the time of return to q, 0 if v
// <= 0.
MARRAM_INLINE VDouble time_to_fall(const VDouble& q, const VDouble& v, const VDouble& g, double low) {
    const VDouble drop = vmax(q - low, 0.0), root = vsqrt(v * v + 2.0 * g * drop);
    const VLong rises = v > 0.0;
    const VDouble time = select(rises, v + root, 2.0 * drop) / select(rises, g, root - v);
    return select(rises | (drop > 0.0), time, 0.0);
}

// Time until a point with constant velocity leaves an interval. NaN at a border without velocity.
MARRAM_INLINE VDouble time_to_leave(const VDouble& q, const VDouble& v, const VDouble& low,
                                    const VDouble& high) {
    return vmax(select(v > 0.0, high - q, q - low), 0.0) / vabs(v);
}

MARRAM_INLINE void find_end_state(double drag_time, Grains8& g) {
    if (drag_time <= 0.0) {
        g.end_x = g.x + (g.v + g.acceleration * (0.5 * g.end)) * g.end;
        g.end_v = g.v + g.acceleration * g.end;
        return;
    }
    const VDouble tau = splat(drag_time), decay = one_minus_exp(g.end / drag_time);
    const Wide3d final_velocity = g.v + g.acceleration * tau;
    g.end_x = g.x + final_velocity * g.end + (g.v - final_velocity) * (tau * decay);
    g.end_v = g.v + (final_velocity - g.v) * decay;
}

MARRAM_INLINE VLong as_lanes(ArcEnd end) { return VLong::splat(int64_t(end)); }
MARRAM_INLINE VLong as_lanes(GrainSide side) { return VLong::splat(int64_t(side)); }

// Without drag an arc is a parabola that ends on level sand or at a side of the box.
MARRAM_INLINE void find_arc_ends(const GrainTracer& tracer, Grains8& g) {
    const GrainBox& box = tracer.box;
    const double gravity = tracer.settings.gravity;
    const Wide3d along = splat3(box.along.data()), across = splat3(box.across.data());
    const VDouble s = dot(g.x, along), t = dot(g.x, across), vs = dot(g.v, along), vt = dot(g.v, across);
    const VDouble edge = 4.0 * grain_step * (vabs(s) + vabs(t) + box.size);
    g.end = splat(longest_arc), g.at_end = as_lanes(ArcEnd::goes_on), g.side = as_lanes(GrainSide::downwind);
    const auto ends_before = [&](const VDouble& time, ArcEnd at_end, const VLong& side) MARRAM_ALWAYS_INLINE {
        const VLong before = time < g.end;
        g.end = select(before, time, g.end);
        g.at_end = select(before, as_lanes(at_end), g.at_end), g.side = select(before, side, g.side);
    };
    ends_before(time_to_leave(s, vs, box.start - edge, splat(box.s1)), ArcEnd::leaves,
                select(vs > 0.0, as_lanes(GrainSide::downwind), as_lanes(GrainSide::upwind)));
    ends_before(time_to_leave(t, vt, box.t0 - edge, box.t1 + edge), ArcEnd::leaves,
                select(vt > 0.0, as_lanes(GrainSide::right), as_lanes(GrainSide::left)));
    if (gravity == 0.0)
        ends_before(select(g.v.y > 0.0, time_to_leave(g.x.y, g.v.y, splat(box.y0), splat(box.y1)), infinity),
                    ArcEnd::leaves, as_lanes(GrainSide::above));
    const auto& ground = tracer.settings.ground; // above box.y0
    ends_before(time_to_fall(g.x.y, g.v.y, splat(gravity), ground.value_or(box.y0)),
                ground ? ArcEnd::lands : ArcEnd::leaves, as_lanes(GrainSide::below));
    find_end_state(0.0, g);
    if (ground) g.end_x.y = select(g.at_end == int64_t(ArcEnd::lands), *ground, g.end_x.y);
}

// With drag the speed of the air is held constant over one chord, so each chord is an arc.
MARRAM_INLINE void find_arc_ends_with_drag(const GrainTracer& tracer, Grains8& g) {
    const GrainBox& box = tracer.box;
    const double tau = tracer.settings.drag_time;
    g.end = g.first_chord_time, g.at_end = as_lanes(ArcEnd::goes_on), g.side = as_lanes(GrainSide::downwind);
    find_end_state(tau, g);
    VLong lands = {};
    if (const auto& ground = tracer.settings.ground) {
        lands = g.end_x.y < *ground;
        if (any(lands)) {
            // Newton's iteration, from where a parabola with the acceleration at the start lands: hops can be
            // much shorter than a chord, and from where the chord meets the sand they would take many steps.
            const VDouble begin = time_to_fall(g.x.y, g.v.y, vmax(-g.acceleration.y, 0.0), *ground);
            g.end = select(lands, vmin(begin, g.first_chord_time), g.end);
            find_end_state(tau, g);
            for (int k = 0; k < 4; ++k) {
                const VLong falls = lands & (g.end_v.y < 0.0);
                const VDouble next = g.end + (g.end_x.y - *ground) / -g.end_v.y;
                g.end = select(falls, vmin(vmax(next, 0.0), g.first_chord_time), g.end);
                find_end_state(tau, g);
            }
            g.end_x.y = select(lands, *ground, g.end_x.y);
        }
    }
    const VDouble s = dot(g.end_x, splat3(box.along.data())), t = dot(g.end_x, splat3(box.across.data()));
    const VDouble edge = 4.0 * grain_step * (vabs(s) + vabs(t) + box.size);
    VLong leaves = {};
    const auto leaves_if = [&](const VLong& beyond, GrainSide side) MARRAM_ALWAYS_INLINE {
        leaves = leaves | beyond;
        g.side = select(beyond, as_lanes(side), g.side);
    };
    if (tracer.settings.gravity <= 0.0)
        leaves_if((g.end_x.y > box.y1) & (g.end_v.y >= 0.0), GrainSide::above);
    leaves_if(g.end_x.y < box.y0, GrainSide::below);
    leaves_if(t > box.t1 + edge, GrainSide::right);
    leaves_if(t < box.t0 - edge, GrainSide::left);
    leaves_if(s < box.start - edge, GrainSide::upwind);
    leaves_if(s > box.s1, GrainSide::downwind);
    g.at_end = select(leaves, as_lanes(ArcEnd::leaves), g.at_end);
    g.at_end = select(lands, as_lanes(ArcEnd::lands), g.at_end);
}

MARRAM_INLINE VLong is_outside_horizontally(const GrainBox& box, const Wide3d& p) {
    const VDouble s = dot(p, splat3(box.along.data())), t = dot(p, splat3(box.across.data()));
    return (s < box.start) | (s > box.s1) | (t < box.t0) | (t > box.t1);
}

MARRAM_INLINE float gravity_of_parabolas(const GrainTracer& tracer) {
    return tracer.settings.drag_time > 0.0 ? 0.0F : float(tracer.settings.gravity);
}

// With drag the only chord is straight, and may leave the box: what is outside is not known to be empty. The
// rounding of arcs to floats, in proportion to `arc_length`, is part of the clearance.
MARRAM_INLINE void set_parabolas(const GrainTracer& tracer, const VDouble& arc_length, const Grains8& g,
                                 Parabolas8& p) {
    const bool drags = tracer.settings.drag_time > 0.0;
    // Chords lie up to `sag` below their arc, so within sag / 2 of the arc lowered by sag / 2.
    const double half_sag = drags ? 0.0 : 0.5 * tracer.sag;
    Wide3d x = g.x - splat3(tracer.empty.low().data());
    x.y -= half_sag;
    const Wide3d v = drags ? (g.end_x - g.x) * (1.0 / vmax(g.end, 1e-300)) : g.v;
    const Wide3f from = to_float(x), velocity = to_float(v);
    const auto set = [](VFloat(&to)[3], const Wide3f& of)
                         MARRAM_ALWAYS_INLINE { to[0] = of.x, to[1] = of.y, to[2] = of.z; };
    set(p.x, from), set(p.v, velocity);
    const VFloat end = to_float(g.end);
    p.t_max = (VFloat)((VInt)end -
                       low_32_bits(to_double(end) < g.end)); // the first float that is not before the end
    p.t_clear = VFloat{};
    p.gravity = gravity_of_parabolas(tracer);
    // No step is long enough where a ray is needed: the hook wants them all, and outside the box nothing is
    // known.
    VLong needs_ray = tracer.hooks.rays ? all_lanes : VLong{};
    if (drags)
        needs_ray = needs_ray | is_outside_horizontally(tracer.box, g.x) |
                    is_outside_horizontally(tracer.box, g.end_x);
    p.min_step = to_float(select(needs_ray, infinity, 0.125 * vmin(g.chord_time, g.end)));
    p.clearance = to_float(half_sag + 0x1p-20 * (max_coordinate(x) + arc_length));
}

MARRAM_INLINE void find_arcs(const GrainTracer& tracer, Grains8& g, Parabolas8& p) {
    const GrainSettings& s = tracer.settings;
    g.chords_left = vmax(g.chords_left, 0.0);
    const bool drags = s.drag_time > 0.0;
    g.acceleration = {splat(0.0), splat(-s.gravity), splat(0.0)};
    VDouble a = splat(s.gravity);
    g.chord_time = splat(tracer.chord_time);
    if (drags) {
        const VDouble air = stream_speeds(s, vmax(g.x.y - s.ground.value_or(tracer.box.base), 0.0));
        g.acceleration.x += (air * tracer.box.along.x() - g.v.x) / s.drag_time;
        g.acceleration.y -= g.v.y / s.drag_time;
        g.acceleration.z += (air * tracer.box.along.z() - g.v.z) / s.drag_time;
        a = length(g.acceleration);
        g.chord_time = select(a > 0.0, vsqrt(8.0 * tracer.sag / a), longest_arc);
    }
    const VDouble v = length(g.v);
    if (const VLong crosses = g.chord_time * v > tracer.box.size; any(crosses)) {
        const VDouble across = vmin(g.chord_time, 1.01 * tracer.box.size / v);
        g.chord_time = select(crosses, across, g.chord_time);
    }
    const VDouble falls = -dot(g.acceleration, g.normal);
    const VDouble half_hop = vmax(dot(g.v, g.normal), 0.0) / falls;
    g.first_chord_time = select(falls > 0.0, vmin(g.chord_time, half_hop), g.chord_time);
    if (drags)
        find_arc_ends_with_drag(tracer, g);
    else
        find_arc_ends(tracer, g);
    const VDouble more = vmin((g.end - g.first_chord_time) / g.chord_time, max_chords);
    g.chords = select(g.end > g.first_chord_time, 1.0 - vfloor(-more), 1.0);
    const VLong gives_up = g.chords > g.chords_left;
    if (any(gives_up)) {
        const VDouble last = g.chords_left - 1.0;
        const VDouble end = select(last >= 0.0, g.first_chord_time + last * g.chord_time, 0.0);
        g.end = select(gives_up, end, g.end);
        g.chords = select(gives_up, g.chords_left, g.chords);
        g.at_end = select(gives_up, as_lanes(ArcEnd::gives_up), g.at_end);
        const Wide3d end_x = g.end_x, end_v = g.end_v;
        find_end_state(s.drag_time, g);
        g.end_x = select(gives_up, g.end_x, end_x), g.end_v = select(gives_up, g.end_v, end_v);
    }
    set_parabolas(tracer, (v + 0.5 * a * g.end) * g.end, g, p);
    g.normal = {splat(0.0), select(g.at_end == int64_t(ArcEnd::lands), 1.0, 0.0), splat(0.0)};
}

// What comes next after ArcEnd.
constexpr int32_t after_arc[] = {int32_t(Next::start_arc), int32_t(Next::leave_sand),
                                 int32_t(Next::end_flight), int32_t(Next::end_flight)};

MARRAM_INLINE VInt next_of(const Parabolas8& p, VInt after) {
    const VInt before_end = p.is_near ? VInt{} + int32_t(Next::trace_ray) : VInt{} + int32_t(Next::fly);
    return p.t_clear >= p.t_max ? after : before_end;
}

MARRAM_INLINE void store_arcs(bool drags, const Grains8& g, const Parabolas8& p, GrainBatch grains,
                              Next* next) {
    store_four(g.x, g.first_chord_time, grains,
               [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.x.data(); });
    store_four(g.v, g.chord_time, grains, [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.v.data(); });
    store_four(g.normal, g.chords_left, grains,
               [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.normal.data(); });
    if (drags)
        store_four(g.acceleration, g.first_chord_time, grains, // chord_t0 is set when it is needed
                   [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.acceleration.data(); });
    store_four(g.end_x, g.end, grains, [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.end.x.data(); });
    store_four(g.end_v, g.chords, grains,
               [](Grain& grain) MARRAM_ALWAYS_INLINE { return grain.end.v.data(); });
    VFloat rows[lanes] = {p.x[0], p.x[1], p.x[2], p.v[0], p.v[1], p.v[2], p.t_max, p.min_step};
    transpose(rows);
    const VInt how = low_32_bits(g.at_end), side = low_32_bits(g.side);
    VInt after;
    for (size_t k = 0; k < lanes; ++k) after[k] = after_arc[how[k]];
    const VInt nexts = next_of(p, after);
    const VLong has_first = g.first_chord_time > 0.0;
    for (size_t k = 0; k < grains.size(); ++k) {
        Grain& grain = *grains[k];
        std::memcpy(&grain.parabola, &rows[k], sizeof rows[k]);
        grain.parabola.clearance = p.clearance[k], grain.parabola.t_clear = p.t_clear[k];
        grain.parabola.after = after[k];
        grain.end.how = ArcEnd(how[k]), grain.end.side = GrainSide(side[k]);
        grain.chord = has_first[int(k)] != 0 ? 0 : 1;
        next[k] = Next(nexts[k]);
    }
}

MARRAM_INLINE void load_parabolas(const std::array<const Grain*, lanes>& grains, Parabolas8& to,
                                  VInt& after) {
    VFloat rows[lanes];
    for (size_t k = 0; k < lanes; ++k) {
        const GrainParabola& from = grains[k]->parabola;
        std::memcpy(&rows[k], &from, sizeof rows[k]);
        to.clearance[k] = from.clearance, to.t_clear[k] = from.t_clear, after[k] = from.after;
    }
    transpose(rows);
    for (int axis = 0; axis < 3; ++axis) to.x[axis] = rows[axis], to.v[axis] = rows[3 + axis];
    to.t_max = rows[6], to.min_step = rows[7];
}

// The half of a batch that is in Grains16::half[n]. Where there is none, the first grain repeats.
MARRAM_INLINE GrainBatch half_of(GrainBatch grains, size_t n) {
    const size_t first = n * lanes;
    return first < grains.size() ? grains.subspan(first, std::min(grains.size() - first, size_t(lanes)))
                                 : grains.first(1);
}

struct Landings8 {
    EventKeys8 keys;
    VLong has_hit; // a mask: rock, before
};

MARRAM_HOT void find_both_ejections(const GrainTracer& tracer, const std::array<Landings8, 2>& landings,
                                    Grains16& g) {
    for (size_t n = 0; n < 2; ++n) find_ejections(tracer, landings[n].keys, landings[n].has_hit, g.half[n]);
}

MARRAM_HOT void find_both_arcs(const GrainTracer& tracer, Grains16& g) {
    for (size_t n = 0; n < 2; ++n) find_arcs(tracer, g.half[n], g.parabolas[n]);
}

MARRAM_HOT void store_both_arcs(const GrainTracer& tracer, const Grains16& g, GrainBatch grains,
                                NextOfGrains& next) {
    for (size_t n = 0; n * lanes < grains.size(); ++n)
        store_arcs(tracer.settings.drag_time > 0.0, g.half[n], g.parabolas[n], half_of(grains, n),
                   next.data() + n * lanes);
}

struct alignas(64) After16 {
    VInt half[2]; // of Next
};

MARRAM_HOT void load_both_parabolas(const std::array<std::array<const Grain*, lanes>, 2>& grains,
                                    ParabolaPair& to, After16& after) {
    for (size_t n = 0; n < 2; ++n) load_parabolas(grains[n], to[n], after.half[n]);
}

MARRAM_HOT void find_next(const ParabolaPair& pair, const After16& after, GrainBatch grains,
                          NextOfGrains& next) {
    for (size_t n = 0; n < 2; ++n) {
        const VInt nexts = next_of(pair[n], after.half[n]);
        for (size_t k = n * lanes; k < std::min(grains.size(), (n + 1) * lanes); ++k) {
            grains[k]->parabola.t_clear = pair[n].t_clear[k % lanes];
            next[k] = Next(nexts[k % lanes]);
        }
    }
}

MARRAM_HOT void load_states(const std::array<const Grain*, lanes>& from, Grains8& to) {
    VDouble unused, chords;
    load_four(from, to.x, unused, [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.end.x.data(); });
    load_four(from, to.v, chords, [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.end.v.data(); });
    load_four(from, to.normal, to.chords_left,
              [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.normal.data(); });
    to.chords_left -= chords;
}

// ---- rays ----

MARRAM_HOT void find_rays(const GrainTracer& tracer, const std::array<const Grain*, lanes>& grains,
                          Rays8& out) {
    Wide3d x, v, end_x;
    VDouble first_chord_time, chord_time, end;
    load_four(grains, x, first_chord_time,
              [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.x.data(); });
    load_four(grains, v, chord_time, [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.v.data(); });
    load_four(grains, end_x, end, [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.end.x.data(); });
    const VDouble skipped = vfloor(vmin((out.t_clear - first_chord_time) / chord_time, 0x1p30));
    out.chord = select(first_chord_time <= out.t_clear, vmax(out.chord, 1.0 + skipped), out.chord);
    out.t0 = select(out.chord > 0.0, first_chord_time + (out.chord - 1.0) * chord_time, 0.0);
    out.t1 = vmin(first_chord_time + out.chord * chord_time, end);
    // With drag the only chord leads from x to end_x, whatever the acceleration.
    const Wide3d acceleration = {splat(0.0), splat(-tracer.settings.gravity), splat(0.0)};
    const auto place = [&](const VDouble& t)
                           MARRAM_ALWAYS_INLINE { return x + (v + acceleration * (0.5 * t)) * t; };
    const Wide3d from = place(out.t0), to = select(out.t1 < end, place(out.t1), end_x), way = to - from;
    const VDouble distance = length(way);
    const VDouble c = max_coordinate(from);
    out.fails = ~((distance < max_grain_coordinate) & (c < max_grain_coordinate));
    const VDouble overlap = vmin(4.0 * grain_step * c / distance + 1e-6, 1e3);
    out.origin = to_float(from), out.direction = to_float(way);
    out.tfar = to_float(1.0 + select(distance > 0.0, overlap, 0.0));
}

} // namespace

EventSeeds event_seeds(uint32_t seed, uint32_t event) {
    const uint64_t key = hash(seed, 0x6576ULL + event);
    return {uint32_t(key), {uint32_t(hash(key, 1)), uint32_t(hash(key, 2))}};
}

std::vector<uint32_t> ordered_paths(const GrainTracer& tracer, uint64_t first, uint64_t end) {
    const auto place = [&](uint64_t path) {
        const auto at = [&](int dimension) {
            return uint32_t(grain_unit(tracer, path, dimension) * double(start_places));
        };
        const uint32_t across = at(0), up = at(1);
        return across * start_places + (across % 2 == 0 ? up : start_places - 1 - up);
    };
    std::vector<uint16_t> places(end - first);
    std::array<uint32_t, start_places * start_places + 1> starts{};
    for (uint64_t path = first; path < end; ++path) {
        places[path - first] = uint16_t(place(path));
        ++starts[places[path - first] + 1U];
    }
    for (size_t k = 1; k < starts.size(); ++k) starts[k] += starts[k - 1];
    std::vector<uint32_t> order(end - first);
    for (uint64_t path = first; path < end; ++path) order[starts[places[path - first]]++] = uint32_t(path);
    return order;
}

Vec3d Grains16::velocity(size_t k) const { return in_lane(half[k / lanes].v, int(k % lanes)); }

void load_grains(GrainBatch from, Grains16& to) {
    for (size_t n = 0; n < 2; ++n) load_states(all_lanes_of(half_of(from, n)), to.half[n]);
}

void emit_grains(const GrainTracer& tracer, GrainBatch grains, Grains16& to) {
    for (size_t n = 0; n < 2; ++n) {
        Starts8 starts;
        Grains8& g = to.half[n];
        for_lanes(half_of(grains, n), [&](int lane, const Grain& grain) {
            for (int d = 0; d < 5; ++d) starts.numbers[d][lane] = sobol_bits(grain.path, d);
        });
        find_starts(tracer, starts, g);
        for (int lane = 0; lane < lanes; ++lane) {
            const double across = starts.across[lane];
            const auto place = std::min(size_t(across * double(grain_profile)), size_t(grain_profile) - 1);
            g.x.y[lane] += tracer.box.ground[place];
        }
    }
}

void leave_sand(const GrainTracer& tracer, GrainBatch grains, Grains16& g) {
    std::array<Landings8, 2> landings;
    for (size_t n = 0; n < 2; ++n)
        for_lanes(half_of(grains, n), [&](int lane, const Grain& grain) {
            set_keys(tracer, grain, 2 * grain.landings + 1, lane, landings[n].keys);
            landings[n].has_hit[lane] = grain.hits > 0 ? -1 : 0;
        });
    find_both_ejections(tracer, landings, g);
}

void start_arcs(const GrainTracer& tracer, GrainBatch grains, Grains16& g, NextOfGrains& next) {
    find_both_arcs(tracer, g);
    tracer.empty.step(g.parabolas, steps_at_once);
    store_both_arcs(tracer, g, grains, next);
}

void follow_arcs(const GrainTracer& tracer, GrainBatch grains, NextOfGrains& next) {
    ParabolaPair pair;
    After16 after;
    load_both_parabolas({all_lanes_of(half_of(grains, 0)), all_lanes_of(half_of(grains, 1))}, pair, after);
    pair[0].gravity = pair[1].gravity = gravity_of_parabolas(tracer);
    tracer.empty.step(pair, steps_at_once);
    find_next(pair, after, grains, next);
}

uint32_t set_rays(const GrainTracer& tracer, GrainBatch grains, std::span<RTCRayHit> rays) {
    Rays8 found;
    for_lanes(grains, [&](int lane, const Grain& grain) {
        found.chord[lane] = grain.chord, found.t_clear[lane] = double(grain.parabola.t_clear);
    });
    find_rays(tracer, all_lanes_of(grains), found);
    uint32_t fails = 0;
    for (size_t k = 0; k < grains.size(); ++k) {
        const int lane = int(k);
        Grain& grain = *grains[k];
        grain.chord = uint32_t(found.chord[lane]);
        grain.chord_t0 = found.t0[lane], grain.chord_t1 = found.t1[lane];
        RTCRayHit& ray = rays[k];
        ray.ray = {};
        ray.ray.org_x = found.origin.x[lane], ray.ray.org_y = found.origin.y[lane],
        ray.ray.org_z = found.origin.z[lane];
        ray.ray.dir_x = found.direction.x[lane], ray.ray.dir_y = found.direction.y[lane],
        ray.ray.dir_z = found.direction.z[lane];
        ray.ray.tfar = found.tfar[lane];
        ray.ray.mask = tracer.settings.ray_mask;
        ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        fails |= uint32_t(found.fails[lane] & 1) << k;
    }
    return fails;
}

} // namespace marram
