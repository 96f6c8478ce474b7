// SPDX-License-Identifier: Apache-2.0
// Shear stress of the wind over a smooth surface, by linear theory.
//
// A surface h of gentle slope changes the stress tau_0 of a turbulent boundary layer by a vector tau' that is
// linear in h and independent of scale except for logarithms (P. Jackson and J. Hunt, "Turbulent wind flow
// over a low hill", Q. J. R. Meteorol. Soc. 101, 1975; W. Weng et al., "Air flow and sand transport over
// sand-dunes", Acta Mech. Suppl. 2, 1991). Without the logarithms (K. Kroy, G. Sauermann, H. Herrmann,
// "Minimal model for aeolian sand dunes", Phys. Rev. E 66, 2002; F. Charru, B. Andreotti, P. Claudin, "Sand
// ripples and dunes", Annu. Rev. Fluid Mech. 45, 2013), in Fourier space with x along the wind:
//
//   tau'_x / tau_0 = (A + i B sign(k_x)) k_x^2 / |k| h
//   tau'_y / tau_0 = cross (A + i B sign(k_x)) k_x k_y / |k| h
//
// For waves along the wind this is (A + i B) |k| h: the maximum stress is at a phase atan(B / A) before the
// crest, which makes a flat bed unstable. Kroy et al. write A (|k| + i B k): their A B is B here. The stress
// acts along the wave vector, like the pressure gradient. Its response across the wind is less certain:
// linearising |u| u gives cross = 1/2; Weng's terms for z0 = 0.1 mm and waves of 20 m give 1 or more. With
// 1/2 the horns of a barchan point outwards; with 1 sand leaves its flanks sideways; 0.75 is between.
//
// Length of dunes. A = 3.5, B = 2 (z0 of 1 mm) gives the first waves of a flat bed their natural length, 21 L_sat. How
// long a barchan of some height is depends on the wind: where the flux has to fall to 0, at its foot, the stress falls
// to the threshold. The weaker the wind, the smaller this fall, and the slope that makes it. At u* = 0.36 m/s
// (threshold 0.22) widths and lengths are within 30 % of lines through field data; at 0.5 m/s lengths are about half
// (build/dune_solver barchans 7 0.5).
//
// Transforms: pairs of columns are the real and imaginary part of one transform. The spectrum is kept only
// for row wave numbers 0 ... rows / 2. The inverse transform returns along as the real and across as the
// imaginary part. At the Nyquist wave numbers, whose sign is undefined, the response is the mean of both
// signs. The mean of the surface has no effect.
//
// Resolution. Below 1, waves across the rows that are shorter than 2 cells / resolution make no stress. Whole
// blocks of eight of them are neither transformed along the rows nor multiplied, and take no memory.
//
// Error: floats; 1e-6 of the greatest stress. Linear theory holds for slopes up to about 20 degrees.
// Cost: 1.5 complex transforms in two dimensions. Memory: 8 bytes a cell.
#include "procedural/air/shear.h"

#include "core/math/vec.h"
#include "procedural/abi/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

using ShearScratch = tbb::enumerable_thread_specific<WideVector<WideComplex>>;

// Transforms sixteen columns as eight complex ones, separates them, and stores them column by column in
// blocks of eight wave numbers.
MARRAM_HOT void shear_forward(const Transform& transform, const float* surface, size_t pitch, size_t columns,
                              size_t blocks, WideComplex* data, WideComplex* scratch, WideComplex* spectrum) {
    const size_t n = size_t(transform.size());
    for (size_t j = 0; j < n; ++j) data[j] = {vload(surface + j * pitch), vload(surface + j * pitch + 8)};
    const WideComplex* z = transform.run(data, scratch);
    for (size_t block = 0; block < blocks; ++block) {
        std::array<VFloat, 8> u_re{}, u_im{}, v_re{}, v_im{};
        for (size_t l = 0; l < 8; ++l) {
            const size_t k = block * 8 + l;
            if (2 * k > n) continue;
            const WideComplex a = z[k], b = z[k == 0 ? 0 : n - k];
            u_re[l] = 0.5F * (a.re + b.re), u_im[l] = 0.5F * (a.im - b.im);
            v_re[l] = 0.5F * (a.im + b.im), v_im[l] = 0.5F * (b.re - a.re);
        }
        transpose(u_re.data()), transpose(u_im.data());
        transpose(v_re.data()), transpose(v_im.data());
        for (size_t l = 0; l < 8; ++l) {
            if (l < columns) spectrum[l * blocks + block] = {u_re[l], u_im[l]};
            if (l + 8 < columns) spectrum[(l + 8) * blocks + block] = {v_re[l], v_im[l]};
        }
    }
}

struct ShearWaves {
    double row, column;           // unit vector of the wind
    double row_step, column_step; // wave numbers
    float row_cutoff;             // rows' wave numbers above it make no stress
    float in_phase, out_of_phase, cross;
    float scale; // normalization of the transforms
};

struct ShearResponse {
    WideComplex along, across;
};
MARRAM_INLINE ShearResponse shear_response(const ShearWaves& waves, VFloat k_row, float k_column,
                                           const WideComplex& h) {
    const float w_row = float(waves.row), w_column = float(waves.column);
    const VFloat along = w_row * k_row + w_column * k_column, side = w_row * k_column - w_column * k_row;
    const VFloat square = along * along + side * side, none = splat_float(0.0F);
    const VFloat g =
        (square > 0.0F) & (k_row <= waves.row_cutoff) ? waves.scale * along / vsqrt(square) : none;
    const VFloat b = along > 0.0F ? none + waves.out_of_phase : none - waves.out_of_phase;
    const VFloat re = g * (waves.in_phase * h.re - b * h.im), im = g * (waves.in_phase * h.im + b * h.re);
    const VFloat s = waves.cross * side;
    return {{re * along, im * along}, {re * s, im * s}};
}

// For eight row wave numbers: transforms over the columns, multiplies by the kernel, transforms back.
MARRAM_HOT void shear_convolve(const Transform& transform, const ShearWaves& waves, size_t block,
                               size_t blocks, WideComplex* spectrum, WideComplex* across,
                               WideComplex* scratch) {
    const size_t n = size_t(transform.size());
    WideComplex *const first = scratch, *const second = scratch + n, *const third = scratch + 2 * n;
    for (size_t b = 0; b < n; ++b) first[b] = spectrum[b * blocks + block];
    WideComplex* const x = transform.run(first, second);
    WideComplex* const spare = x == first ? second : first;
    VFloat k_row{};
    for (int l = 0; l < lanes; ++l) k_row[l] = float(waves.row_step * double(block * 8 + size_t(l)));
    for (size_t b = 0; b < n; ++b) {
        const float k_column = float(waves.column_step * (2 * b > n ? double(b) - double(n) : double(b)));
        ShearResponse response = shear_response(waves, k_row, k_column, x[b]);
        if (2 * b == n) { // mean of both signs
            const ShearResponse other = shear_response(waves, k_row, -k_column, x[b]);
            response = {
                {0.5F * (response.along.re + other.along.re), 0.5F * (response.along.im + other.along.im)},
                {0.5F * (response.across.re + other.across.re),
                 0.5F * (response.across.im + other.across.im)}};
        }
        x[b] = {response.along.im, response.along.re}; // swapped, for the inverse
        third[b] = {response.across.im, response.across.re};
    }
    const WideComplex* result = transform.run(x, spare);
    for (size_t b = 0; b < n; ++b) spectrum[b * blocks + block] = {result[b].im, result[b].re};
    result = transform.run(third, spare);
    for (size_t b = 0; b < n; ++b) across[b * blocks + block] = {result[b].im, result[b].re};
}

// Inverse transform of eight columns of both results.
MARRAM_HOT void shear_inverse(const Transform& transform, const WideComplex* along, const WideComplex* across,
                              size_t columns, size_t blocks, WideComplex* data, WideComplex* scratch,
                              size_t keep, size_t pitch, float* out_along, float* out_across) {
    const size_t n = size_t(transform.size());
    for (size_t block = 0; block < blocks; ++block) {
        std::array<VFloat, 8> x_re{}, x_im{}, y_re{}, y_im{};
        for (size_t l = 0; l < columns; ++l) {
            x_re[l] = along[l * blocks + block].re, x_im[l] = along[l * blocks + block].im;
            y_re[l] = across[l * blocks + block].re, y_im[l] = across[l * blocks + block].im;
        }
        transpose(x_re.data()), transpose(x_im.data());
        transpose(y_re.data()), transpose(y_im.data());
        for (size_t l = 0; l < 8; ++l) {
            const size_t k = block * 8 + l;
            if (2 * k > n) break;
            if (k == 0 || 2 * k == n)
                data[k] = {y_re[l], x_re[l]};
            else {
                data[k] = {x_im[l] + y_re[l], x_re[l] - y_im[l]}; // x + i y, swapped
                data[n - k] = {y_re[l] - x_im[l], x_re[l] + y_im[l]};
            }
        }
    }
    for (size_t k = 8 * blocks; k + 8 * blocks <= n; ++k) data[k] = WideComplex{};
    const WideComplex* z = transform.run(data, scratch);
    for (size_t j = 0; j < keep; ++j) {
        vstore(out_along + j * pitch, z[j].im);
        vstore(out_across + j * pitch, z[j].re);
    }
}

// Weight of the border before the padding: from 1 at the grid's end to 0 at its start.
float padding_blend(int k, int count) {
    const double t = double(k + 1) / (count + 1);
    return float(1.0 - t * t * (3.0 - 2.0 * t));
}

} // namespace

Shear::Shear(int rows, int columns, double cell, double resolution)
    : rows_(rows), columns_(columns), cell_(cell),
      last_wave_(std::clamp(int(std::lround(resolution * 0.5 * rows)), std::min(rows / 2, 1), rows / 2)),
      blocks_(size_t(last_wave_ + 1 + lanes - 1) / lanes), spectrum_(blocks_ * size_t(columns)),
      across_(blocks_ * size_t(columns)) {}

void Shear::forward(const float* surface) {
    const size_t columns = size_t(columns_.size()), n = size_t(rows_.size());
    const size_t row_pitch = size_t(pitch(columns_.size()));
    ShearScratch scratch;
    marram::parallel_for(size_t(0), (columns + 15) / 16, [&](size_t group) {
        WideVector<WideComplex>& mine = scratch.local();
        mine.resize(2 * n);
        shear_forward(rows_, surface + group * 16, row_pitch, std::min(columns - group * 16, size_t(16)),
                      blocks_, mine.data(), mine.data() + n, spectrum_.data() + group * 16 * blocks_);
    });
}

void Shear::convolve(const ShearCoefficients& coefficients, double wind_row, double wind_column) {
    const size_t n = size_t(columns_.size());
    const double step = 2.0 * pi / cell_;
    const ShearWaves waves = {
        wind_row,
        wind_column,
        step / rows_.size(),
        step / columns_.size(),
        float(step / rows_.size() * (last_wave_ + 0.5)), // between waves, so that rounding does not matter
        float(coefficients.in_phase),
        float(coefficients.out_of_phase),
        float(coefficients.cross),
        float(1.0 / (double(rows_.size()) * columns_.size()))};
    ShearScratch scratch;
    marram::parallel_for(size_t(0), blocks_, [&](size_t block) {
        WideVector<WideComplex>& mine = scratch.local();
        mine.resize(3 * n);
        shear_convolve(columns_, waves, block, blocks_, spectrum_.data(), across_.data(), mine.data());
    });
}

void Shear::inverse(int keep_rows, int keep_columns, float* along, float* across) {
    const size_t n = size_t(rows_.size()), columns = size_t(columns_.size());
    const size_t row_pitch = size_t(pitch(keep_columns));
    ShearScratch scratch;
    marram::parallel_for(size_t(0), size_t(keep_columns + 15) / 16, [&](size_t group) {
        WideVector<WideComplex>& mine = scratch.local();
        mine.resize(2 * n);
        for (size_t b = group * 16; b < group * 16 + 16; b += 8) {
            const size_t count = b < columns ? std::min(columns - b, size_t(8)) : 0;
            const size_t at = count > 0 ? b * blocks_ : 0;
            shear_inverse(rows_, spectrum_.data() + at, across_.data() + at, count, blocks_, mine.data(),
                          mine.data() + n, size_t(keep_rows), row_pitch, along + b, across + b);
        }
    });
}

void Shear::perturbation(const ShearCoefficients& coefficients, double wind_row, double wind_column,
                         const float* surface, int keep_rows, int keep_columns, float* along, float* across) {
    forward(surface);
    convolve(coefficients, wind_row, wind_column);
    inverse(keep_rows, keep_columns, along, across);
}

int padded_size(int size) { return Transform::good_size(size + std::max(size / 4, 8)); }

void pad_surface(int rows, int columns, int padded_rows, int padded_columns, float* surface) {
    const size_t pitch = size_t(Shear::pitch(padded_columns));
    marram::parallel_for(0, rows, [&](int r) {
        float* const out = surface + size_t(r) * pitch;
        const float first = out[0], last = out[columns - 1];
        for (int c = columns; c < padded_columns; ++c)
            out[c] = first + padding_blend(c - columns, padded_columns - columns) * (last - first);
        for (size_t c = size_t(padded_columns); c < pitch; ++c) out[c] = 0.0F;
    });
    const float *const first = surface, *const last = first + size_t(rows - 1) * pitch;
    marram::parallel_for(rows, std::max(padded_rows, rows), [&](int r) {
        const float blend = padding_blend(r - rows, padded_rows - rows);
        float* const out = surface + size_t(r) * pitch;
        for (size_t c = 0; c < pitch; ++c) out[c] = first[c] + blend * (last[c] - first[c]);
    });
}

} // namespace marram
