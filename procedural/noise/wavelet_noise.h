// SPDX-License-Identifier: Apache-2.0
// Wavelet noise, after R. Cook & T. DeRose, "Wavelet Noise" (SIGGRAPH 2005): noise limited to one band of
// frequencies.
//
// The paper. Let S1 be the quadratic B-splines with knots one cell apart, and S0 those with knots two cells
// apart; S0 is a subspace of S1. Let R be a random spline of S1. N is R minus its least-squares approximation
// in S0, N = R - up(down(R)): N has no component that half the resolution can represent, and it is fully
// represented at its own. Octaves of N share no frequencies, except through the soft edges of the B-spline's
// spectrum, and an octave too fine for a pixel averages to 0 there.
//
// On one axis let w = 2 pi f be the coefficients' frequency (f in cycles a cell). With the refinement B(x) =
// sum p_k B(2x - k), p = (1, 3, 3, 1) / 4, and the inner products of B's translates r = (1, 26, 66, 26, 1) /
// 120 (a quintic B-spline),
//
//     r(w) = (66 + 52 cos w + 2 cos 2w) / 120,        c(w) = cos^6(w / 2) r(w) / r(2w),        c(w) + c(w + pi) = 1,
//
// the projection onto S0 multiplies frequency w by c(w) and aliases a part of it to w + pi. c falls from 1 at
// f = 0 through 1/2 at f = 1/4 to 0 at f = 1/2, the limit of S1. In space up(down()) is the product over
// three axes.
//
// Even and odd. N depends on whether S0's knots are the even or the odd cells, and its variance alternates
// between them. The paper adds to N a copy shifted by an odd number of cells, which halves the difference but
// makes the tile repeat at half its size. Here N is the mean over all eight choices of knots, for one R. In
// the mean the aliased parts cancel and only c is left. So the mean costs nothing, is exact, and N is
// stationary. Its energy also falls off faster below the band, as (1 - C)^2 where the paper's falls as 1 - C,
// with C the product of c over the axes: 0.2 % of it lies below |f| = 1/4 instead of 1.5 %, and 1e-9 below
// 1/8 instead of 7e-6:
//
//     N(w) = R(w) (1 - c(w_x) c(w_y) c(w_z)).
//
// Definition, for an independent evaluation. All indices of the tile are modulo n = 64.
//   tile       R_a[i, j, k] = unit_float(mix32(mix32(m) ^ 0x9e3779b9)) - 1/2 with m = a n^3 + (k n + j) n + i, for the
//              three components a. N_a as above at the tile's own frequencies 2 pi m / n (w = 0 vanishes exactly), then
//              each scaled so that its spline's mean square over the tile is perlin_rms_3d^2. Kept as floats.
//   spline     N_a(q) = sum over the 27 cells nearest to q of N_a[i, j, k] B(q_x - i) B(q_y - j) B(q_z - k), with B the
//              quadratic B-spline centred at 0: 3/4 - x^2 for |x| <= 1/2, (3/2 - |x|)^2 / 2 to 3/2, 0 beyond.
//   place      q = Q p + o for a point p in cells. Q turns world axes to the tile's by the unit quaternion
//              (w, x, y, z) = (7, 4, 7, 15) / sqrt(339); o_x, o_y, o_z = n 2^-32 mix32(s + 0x9e3779b9 d), d = 1, 2, 3,
//              where s is the layer's seed. Offsets differ by octave, by seed and by layer of time.
//   evolution  At w cells, with W = floor(w), t = w - W, u = 6t^5 - 15t^4 + 10t^3 and the octave's seed S:
//              ((1 - u) N(s = S ^ (W * 0x27d4eb2f)) + u N(s = S ^ ((W + 1) * 0x27d4eb2f))) / sqrt(u^2 + (1 - u)^2),
//              32-bit arithmetic. Without evolution it is N(s = S), that is w = 0.
//
// At any time the field is a sum of two fields of the band, so it is in the band itself. The two are
// independent and their squared weights sum to 1, so the rms is constant; u makes the field C2 in time. The
// period in w is 2^32.
//
// Purpose of the rotation Q: the tile repeats every 64 cells, but only along its own three axes. Along a
// world axis it repeats exactly after 64 * 339 = 21,696 cells. A path along a world axis, or along a diagonal
// between two, is 3,899 cells long before it comes within 2 cells of itself in the tile. A plane across a
// world axis first comes within 1.5 cells of its own copy at a distance of 293 cells. (The best of 4,000
// quaternions of integers up to 15.) A wind along one of the tile's own axes, to within a degree or two, does
// see the same values every 64 cells. Seeds select a position in the tile, not another tile.
//
// Cost: the tile takes 4 MiB and 8 to 12 ms, once a process, at the first call (read_wind calls it if a scene
// uses this noise). A sample costs what a sample of Perlin noise does.
#pragma once

#include "core/math/hash.h"
#include "core/math/simd.h"

#include <cstdint>
#include <cstring>

namespace marram {

// The three components of a coefficient; the fourth is 0.
using Quad = float __attribute__((vector_size(16), aligned(16)));

inline constexpr int wavelet_tile_size = 64; // n; a power of two, for the wrap

// The tile, [(k n + j) n + i]. Safe to call from any thread.
const Quad* wavelet_tile();

// The offset o of the layer with this seed: 0 ... n cells on each axis.
inline Wide3d wavelet_offset(uint32_t layer_seed) {
    const auto along = [&](uint32_t axis) {
        return splat(wavelet_tile_size * 0x1p-32 * mix32(layer_seed + 0x9e3779b9U * axis));
    };
    return {along(1), along(2), along(3)};
}

// The field repeats exactly after this many cells along a world axis, because Q is integers over 339.
inline constexpr double wavelet_period = wavelet_tile_size * 339.0;

// Q p for a point in cells, |p| <= 2^50, minus whole periods. The periods are subtracted first, where that is
// exact (all are multiples of p's last bit), so that rotating p loses no accuracy far from the origin.
MARRAM_INLINE Wide3d wavelet_turn(const Wide3d& p) {
    const auto reduced = [](VDouble x) MARRAM_ALWAYS_INLINE {
        return x - vround(x * (1.0 / wavelet_period)) * wavelet_period;
    };
    const VDouble x = reduced(p.x), y = reduced(p.y), z = reduced(p.z);
    constexpr double s = 1.0 / 339.0;
    return {x * (-209.0 * s) + y * (-154.0 * s) + z * (218.0 * s),
            x * (266.0 * s) + y * (-143.0 * s) + z * (154.0 * s),
            x * (22.0 * s) + y * (266.0 * s) + z * (209.0 * s)};
}

// N(q) for eight positions |q| < 2^30. The weights are computed for all eight at once. The coefficients are
// summed one position at a time, three components in one register, because they are adjacent in memory: 27
// loads a position, where gathering for eight positions would take 81 loads each.
MARRAM_INLINE Wide3f wavelet_at(const Quad* tile, const Wide3d& q) {
    constexpr int n = wavelet_tile_size;
    alignas(32) float weight[3][3][lanes];
    alignas(32)
        int32_t place[3][3][lanes]; // of the three coefficients on each axis: their parts of the index
    const VDouble coordinate[3] = {q.x, q.y, q.z};
    constexpr int stride[3] = {1, n, n * n};
    for (int axis = 0; axis < 3; ++axis) {
        VInt nearest;
        const VDouble centre = vfloor(coordinate[axis] + 0.5, nearest);
        const VFloat f = to_float(coordinate[axis] - centre); // -1/2 ... 1/2
        const VFloat below = 0.5F - f, above = 0.5F + f;
        const VFloat weights[3] = {0.5F * below * below, 0.75F - f * f, 0.5F * above * above};
        for (int i = 0; i < 3; ++i) {
            const VInt index = ((nearest + (i - 1)) & (n - 1)) * stride[axis];
            std::memcpy(weight[axis][i], &weights[i], sizeof weights[i]);
            std::memcpy(place[axis][i], &index, sizeof index);
        }
    }
    Wide3f out;
    for (int lane = 0; lane < lanes; ++lane) {
        Quad sum{};
        for (int k = 0; k < 3; ++k) {
            Quad plane{};
            for (int j = 0; j < 3; ++j) {
                const Quad* row = tile + place[2][k][lane] + place[1][j][lane];
                const Quad along = row[place[0][0][lane]] * weight[0][0][lane] +
                                   row[place[0][1][lane]] * weight[0][1][lane] +
                                   row[place[0][2][lane]] * weight[0][2][lane];
                plane += along * weight[1][j][lane];
            }
            sum += plane * weight[2][k][lane];
        }
        out.x[lane] = sum[0];
        out.y[lane] = sum[1];
        out.z[lane] = sum[2];
    }
    return out;
}

} // namespace marram
