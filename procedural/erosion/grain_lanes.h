// SPDX-License-Identifier: Apache-2.0
// What grain_flight.cpp and grain_hits.cpp share: grains to lanes; lengths, random numbers and exponentials
// in lanes.
#pragma once

#include "procedural/erosion/grain_flight.h"
#include "procedural/erosion/sobol.h"

#include <cstddef>
#include <cstring>

namespace marram {

// ---- lanes ----

inline Vec3d in_lane(const Wide3d& from, int lane) { return {from.x[lane], from.y[lane], from.z[lane]}; }

// Lanes without a grain repeat the first.
template <typename F>
void for_lanes(GrainBatch grains, F&& f) {
    for (int lane = 0; lane < lanes; ++lane)
        f(lane, *grains[size_t(lane) < grains.size() ? size_t(lane) : 0]);
}

inline std::array<const Grain*, lanes> all_lanes_of(GrainBatch grains) {
    std::array<const Grain*, lanes> all;
    for_lanes(grains, [&](int lane, const Grain& grain) { all[size_t(lane)] = &grain; });
    return all;
}

// To lanes: the vector f(grain) and the number behind it in each of eight grains. These pairs are read:
static_assert(offsetof(Grain, first_chord_time) == offsetof(Grain, x) + sizeof(Vec3d));
static_assert(offsetof(Grain, chord_time) == offsetof(Grain, v) + sizeof(Vec3d));
static_assert(offsetof(Grain, chords_left) == offsetof(Grain, normal) + sizeof(Vec3d));
static_assert(offsetof(Grain, chord_t0) == offsetof(Grain, acceleration) + sizeof(Vec3d));
static_assert(offsetof(GrainArcEnd, time) == offsetof(GrainArcEnd, x) + sizeof(Vec3d));
static_assert(offsetof(GrainArcEnd, chords) == offsetof(GrainArcEnd, v) + sizeof(Vec3d));
template <typename F>
MARRAM_INLINE void load_four(const std::array<const Grain*, lanes>& grains, Wide3d& xyz, VDouble& w, F&& f) {
    for (int half = 0; half < 2; ++half) {
        Double4 row[4];
        for (int k = 0; k < 4; ++k) {
            const Grain& grain = *grains[size_t(4 * half + k)];
            const auto *const begin = reinterpret_cast<const char*>(&grain),
                              *const vector = reinterpret_cast<const char*>(f(grain));
            std::memcpy(&row[k], begin + (vector - begin), sizeof row[k]); // of the grain, beyond its vector
        }
        const Double4 a = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6),
                      b = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7),
                      c = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6),
                      d = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
        xyz.x.half[half] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
        xyz.y.half[half] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
        xyz.z.half[half] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
        w.half[half] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
    }
}

// From lanes: as load_four() reads them.
template <typename F>
MARRAM_INLINE void store_four(const Wide3d& xyz, const VDouble& w, GrainBatch grains, F&& f) {
    for (int half = 0; half < 2; ++half) {
        const Double4 x = xyz.x.half[half], y = xyz.y.half[half], z = xyz.z.half[half], v = w.half[half];
        const Double4 a = __builtin_shufflevector(x, y, 0, 4, 2, 6),
                      b = __builtin_shufflevector(x, y, 1, 5, 3, 7),
                      c = __builtin_shufflevector(z, v, 0, 4, 2, 6),
                      d = __builtin_shufflevector(z, v, 1, 5, 3, 7);
        const Double4 row[4] = {
            __builtin_shufflevector(a, c, 0, 1, 4, 5), __builtin_shufflevector(b, d, 0, 1, 4, 5),
            __builtin_shufflevector(a, c, 2, 3, 6, 7), __builtin_shufflevector(b, d, 2, 3, 6, 7)};
        for (size_t k = 0; k < 4 && size_t(4 * half) + k < grains.size(); ++k) {
            Grain& grain = *grains[size_t(4 * half) + k];
            auto *const begin = reinterpret_cast<char*>(&grain), *const to =
                                                                     reinterpret_cast<char*>(f(grain));
            std::memcpy(begin + (to - begin), &row[k], sizeof row[k]); // of the grain, beyond its vector
        }
    }
}

MARRAM_INLINE VDouble length(const Wide3d& v) { return vsqrt(dot(v, v)); }
MARRAM_INLINE VDouble max_coordinate(const Wide3d& p) { return vmax(vmax(vabs(p.x), vabs(p.y)), vabs(p.z)); }

// ---- random numbers ----

MARRAM_INLINE VDouble unit_numbers(VUint x) { return (to_double(VInt(x ^ 0x80000000U)) + 0x1p31) * 0x1p-32; }

struct alignas(64) EventKeys8 {
    VUint path, order, scrambling[2];
};

inline void set_keys(const GrainTracer& tracer, const Grain& grain, uint32_t event, int lane,
                     EventKeys8& keys) {
    const EventSeeds seeds = event < tracer.event_seeds.size() ? tracer.event_seeds[event]
                                                               : event_seeds(tracer.settings.seed, event);
    keys.path[lane] = grain.path, keys.order[lane] = seeds.order;
    keys.scrambling[0][lane] = seeds.scrambling[0], keys.scrambling[1][lane] = seeds.scrambling[1];
}

// Two random numbers for an event of a path: Sobol dimensions 0 and 1 at an index that is Owen-shuffled for
// each event.
MARRAM_INLINE void event_numbers(const EventKeys8& keys, VDouble& u0, VDouble& u1) {
    const VUint index = owen_shuffle(keys.path, keys.order);
    u0 = unit_numbers(owen_shuffle(reversed_bits(index), keys.scrambling[0]));
    u1 = unit_numbers(owen_shuffle(sobol_1(index), keys.scrambling[1]));
}

// ---- drag ----

// 1 - e^-x, x >= 0: near 0 by a series, where the difference would lose digits. Error < 1e-13 relative.
MARRAM_INLINE VDouble one_minus_exp(const VDouble& x) {
    VDouble p = splat(1.0 / 40320.0);
    p = 1.0 / 5040.0 - x * p;
    p = 1.0 / 720.0 - x * p;
    p = 1.0 / 120.0 - x * p;
    p = 1.0 / 24.0 - x * p;
    p = 1.0 / 6.0 - x * p;
    p = 0.5 - x * p;
    return select(x < 0.1, x * (1.0 - x * p), 1.0 - vexp(-vmin(x, 700.0)));
}

} // namespace marram
