// SPDX-License-Identifier: Apache-2.0
// The tile of wavelet noise; wavelet_noise.h has the derivation. N = R - P R, with P the product over the
// three axes of
//
//     c(w) = cos^6(w / 2) r(w) / r(2w).
//
// The numerator is a filter of 11 taps: cos^6(w / 2) has the binomials (1, 6, 15, 20, 15, 6, 1) / 64. The
// denominator is inverted exactly by recursive filters, not by the paper's 32 taps (which are good to 3e-4):
// with y = z + 1/z,
//
//     120 r(z) = y^2 + 26 y + 64 = (y - y_1)(y - y_2),  y_1,2 = -13 +- sqrt 105,  y - y_l = -(1 - z_l z)(1 - z_l / z) / z_l
//
// where z_l is the root of z + 1/z = y_l inside the unit circle. So 1 / r(2w) is 120 z_1 z_2 times, for each
// pole, one recursion forwards and one backwards over every other coefficient, a_i += z_l a_(i -+ 2). A line
// is periodic: each recursion computes its start value by first running over the other end of the line, over
// the pole's memory.
#include "procedural/noise/wavelet_noise.h"

#include "procedural/noise/noise.h"

#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr int n = wavelet_tile_size;
constexpr int cells = n * n * n;
constexpr std::array<double, 5> spline_products = {1.0 / 120, 26.0 / 120, 66.0 / 120, 26.0 / 120,
                                                   1.0 / 120}; // r
constexpr std::array<double, 7> binomials = {1.0 / 64,  6.0 / 64, 15.0 / 64, 20.0 / 64,
                                             15.0 / 64, 6.0 / 64, 1.0 / 64};

// Lines of the tile side by side, so that SIMD registers are full and recursions hide their latency.
constexpr int side = 8 * 4;
struct alignas(64) Bundle {
    float at[n][side];
};

// Taps of a symmetric filter: the middle one and those of one side.
template <size_t reach>
using Taps = std::array<float, reach + 1>;

template <size_t reach>
MARRAM_INLINE void convolve(const Taps<reach>& taps, const Bundle& in, Bundle& out) {
    for (int i = 0; i < n; ++i) {
        for (int s = 0; s < side; ++s) out.at[i][s] = taps[0] * in.at[i][s];
        for (int m = 1; m <= int(reach); ++m) {
            const float *below = in.at[(i - m) & (n - 1)], *above = in.at[(i + m) & (n - 1)];
            for (int s = 0; s < side; ++s) out.at[i][s] += taps[size_t(m)] * (below[s] + above[s]);
        }
    }
}

struct Pole {
    float at;
    int memory; // even; after so many coefficients less than 1e-9 of one is left
};

// a_i += pole * a_(i -+ 2) around the line, in place.
MARRAM_INLINE void recurse(Pole pole, bool forwards, Bundle& a) {
    alignas(64) float before[2][side] = {};
    for (int step = -pole.memory; step < n; ++step) {
        const int i = (forwards ? step : n - 1 - step) & (n - 1);
        float* last = before[step & 1];
        for (int s = 0; s < side; ++s) last[s] = a.at[i][s] + pole.at * last[s];
        if (step >= 0) std::memcpy(a.at[i], last, sizeof a.at[i]);
    }
}

// Applies `filter` (in, out) along one axis of a tile of Quads, in place.
template <typename Filter>
MARRAM_INLINE void along_axis(int axis, Quad* tile, Filter&& filter) {
    constexpr int stride[3] = {1, n, n * n}, neighbour[3] = {n, 1, 1}; // between cells, and between lines
    constexpr int at_once = side / 4;
    Bundle in, out;
    for (int far = 0; far < n; ++far)
        for (int near = 0; near < n; near += at_once) {
            Quad* first = tile + far * (axis == 2 ? n : n * n) + near * neighbour[axis];
            for (int i = 0; i < n; ++i)
                for (int line = 0; line < at_once; ++line)
                    std::memcpy(in.at[i] + 4 * line, first + i * stride[axis] + line * neighbour[axis],
                                sizeof(Quad));
            filter(in, out);
            for (int i = 0; i < n; ++i)
                for (int line = 0; line < at_once; ++line)
                    std::memcpy(first + i * stride[axis] + line * neighbour[axis], out.at[i] + 4 * line,
                                sizeof(Quad));
        }
}

struct Projection {
    Taps<5> taps; // of cos^6(w / 2) r(w), times 120 z_1 z_2
    Pole poles[2];
};

Projection projection() {
    Projection p;
    double gain = 120.0;
    for (int l = 0; l < 2; ++l) {
        const double y = -13.0 + (l == 0 ? 1.0 : -1.0) * std::sqrt(105.0);
        const double z = 0.5 * (y + std::sqrt(y * y - 4.0));
        p.poles[l] = {float(z), 2 * int(std::ceil(std::log(1e-9) / std::log(-z)))};
        gain *= z;
    }
    for (int m = 0; m <= 5; ++m) {
        double sum = 0.0;
        for (int i = 0; i < 7; ++i)
            if (const int j = m + 5 - i; j >= 0 && j < 5)
                sum += binomials[size_t(i)] * spline_products[size_t(j)];
        p.taps[size_t(m)] = float(gain * sum);
    }
    return p;
}

MARRAM_HOT void project(const Projection& p, Quad* tile) {
    for (int axis = 0; axis < 3; ++axis)
        along_axis(axis, tile, [&](const Bundle& in, Bundle& out) MARRAM_ALWAYS_INLINE {
            convolve<5>(p.taps, in, out);
            for (const Pole pole : p.poles) {
                recurse(pole, true, out);
                recurse(pole, false, out);
            }
        });
}

// Coefficients to inner products with B's translates.
MARRAM_HOT void take_products(Quad* tile) {
    const Taps<2> taps = {float(spline_products[2]), float(spline_products[1]), float(spline_products[0])};
    for (int axis = 0; axis < 3; ++axis)
        along_axis(axis, tile,
                   [&](const Bundle& in, Bundle& out) MARRAM_ALWAYS_INLINE { convolve<2>(taps, in, out); });
}

WideVector<Quad> white() {
    WideVector<Quad> tile(cells);
    for (uint32_t m = 0; m < uint32_t(cells); ++m)
        for (uint32_t a = 0; a < 3; ++a)
            tile[m][a] = unit_float(mix32(mix32(a * uint32_t(cells) + m) ^ 0x9e3779b9U)) - 0.5F;
    return tile;
}

WideVector<Quad> build() {
    WideVector<Quad> noise = white(), scratch = noise;
    project(projection(), scratch.data());
    for (size_t m = 0; m < cells; ++m) scratch[m] = noise[m] -= scratch[m];
    take_products(scratch.data());
    double squares[3] = {}; // of the splines, over the tile
    for (size_t m = 0; m < cells; ++m)
        for (int a = 0; a < 3; ++a) squares[a] += double(noise[m][a]) * double(scratch[m][a]);
    Quad scale{};
    for (int a = 0; a < 3; ++a) scale[a] = float(perlin_rms_3d / std::sqrt(squares[a] / cells));
    for (Quad& value : noise) value *= scale;
    return noise;
}

} // namespace

const Quad* wavelet_tile() {
    static const WideVector<Quad> tile = build();
    return tile.data();
}

} // namespace marram
