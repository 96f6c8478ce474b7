// SPDX-License-Identifier: Apache-2.0
// Reference implementation of the three noises: one point at a time, in double precision, written from the
// definitions at the heads of noise.h and wavelet_noise.h. Shares only the hash with the tested code. Slow.
#pragma once

#include "core/math/hash.h"
#include "core/math/vec.h"
#include "procedural/noise/noise.h"

#include <array>
#include <cmath>
#include <functional>
#include <vector>

namespace reference {

using marram::FractalNoise;
using marram::mix32;
using marram::NoiseType;
using marram::Vec3d;

inline double quintic(double t) { return t * t * t * (t * (t * 6.0 - 15.0) + 10.0); }
inline uint32_t wrapped(double whole) { return static_cast<uint32_t>(static_cast<int64_t>(whole)); }

inline uint32_t corner_hash(uint32_t i, uint32_t j, uint32_t k, uint32_t seed) {
    const uint32_t h = ((i * 0x9e3779b1U) ^ seed) + 3U * (j * 0x85ebca77U);
    return mix32((h ^ (h >> 15)) * 0x2c1b3c6dU + k * 0xc2b2ae3dU);
}

inline double signed_by(uint32_t bits, int bit, double x) { return (bits >> bit) & 1U ? -x : x; }

inline double gradient_3d(uint32_t bits, const double* d) {
    const uint32_t h = bits & 15U;
    const double first = h < 8 ? d[0] : d[1];
    const double second = h < 4 ? d[1] : (h == 12 || h == 14) ? d[0] : d[2];
    return signed_by(h, 0, first) + signed_by(h, 1, second);
}

inline double gradient_4d(uint32_t bits, const double* d) {
    const uint32_t h = bits & 31U;
    const int left_out = h < 8 ? 3 : h < 16 ? 2 : h < 24 ? 1 : 0;
    double sum = 0.0;
    for (int axis = 0, bit = 0; axis < 4; ++axis)
        if (axis != left_out) sum += signed_by(h, bit++, d[axis]);
    return sum;
}

// One octave at p (in cells): sum over the 8 (or 16) corners.
inline Vec3d perlin(const Vec3d& p, bool four, double w, uint32_t seed) {
    Vec3d value = Vec3d::Zero();
    const double base_w = four ? std::floor(w) : 0.0;
    for (int corner = 0; corner < (four ? 16 : 8); ++corner) {
        double d[4], weight = 1.0;
        uint32_t index[4];
        for (int axis = 0; axis < (four ? 4 : 3); ++axis) {
            const double x = axis < 3 ? p[axis] : w, base = axis < 3 ? std::floor(x) : base_w;
            const int side = (corner >> axis) & 1;
            const double t = x - base, blend = quintic(t);
            d[axis] = t - side;
            weight *= side ? blend : 1.0 - blend;
            index[axis] = wrapped(base) + uint32_t(side);
        }
        const uint32_t layer = four ? seed ^ (index[3] * 0x27d4eb2fU) : seed;
        const uint32_t h = corner_hash(index[0], index[1], index[2], layer);
        for (int a = 0; a < 3; ++a)
            value[a] += weight * (four ? gradient_4d(h >> (8 * a), d) : gradient_3d(h >> (8 * a), d));
    }
    return value;
}

inline constexpr int n = 64;
using Tile = std::vector<Vec3d>;
inline size_t cell(int i, int j, int k) {
    return size_t(((k & (n - 1)) * n + (j & (n - 1))) * n + (i & (n - 1)));
}

// Filters the tile along all three axes with the symmetric filter of frequency response response(w).
inline Tile filtered(Tile tile, const std::function<double(double)>& response) {
    constexpr double pi = 3.14159265358979323846;
    std::array<double, n> taps{};
    for (int m = 0; m < n; ++m)
        for (int f = 0; f < n; ++f)
            taps[size_t(m)] += response(2.0 * pi * f / n) * std::cos(2.0 * pi * (f * m % n) / n) / n;
    for (const int stride : {1, n, n * n}) {
        const Tile in = tile;
        for (size_t at = 0; at < tile.size(); ++at) {
            const int i = int(at) / stride % n;
            const size_t start = at - size_t(i * stride);
            Vec3d sum = Vec3d::Zero();
            for (int m = 0; m < n; ++m)
                sum += taps[size_t(m)] * in[start + size_t(((i - m) & (n - 1)) * stride)];
            tile[at] = sum;
        }
    }
    return tile;
}

inline double products_response(double w) { // r(w)
    return (66.0 + 52.0 * std::cos(w) + 2.0 * std::cos(2.0 * w)) / 120.0;
}

inline double projection_response(double w) { // c(w)
    return std::pow(std::cos(0.5 * w), 6) * products_response(w) / products_response(2.0 * w);
}

inline Tile white_tile() {
    Tile tile(size_t(n * n * n));
    for (uint32_t m = 0; m < uint32_t(n * n * n); ++m)
        for (uint32_t a = 0; a < 3; ++a)
            tile[m][a] =
                double(marram::unit_float(mix32(mix32(a * uint32_t(n * n * n) + m) ^ 0x9e3779b9U))) - 0.5;
    return tile;
}

// Mean square per component of the spline field with these coefficients.
inline Vec3d mean_squares(const Tile& tile) {
    const Tile products = filtered(tile, products_response);
    Vec3d sum = Vec3d::Zero();
    for (size_t m = 0; m < tile.size(); ++m) sum += tile[m].cwiseProduct(products[m]);
    return sum / double(tile.size());
}

inline const Tile& wavelet_tile() {
    static const Tile tile = [] {
        Tile noise = white_tile();
        const Tile coarse = filtered(noise, projection_response);
        for (size_t m = 0; m < noise.size(); ++m) noise[m] -= coarse[m];
        const Vec3d squares = mean_squares(noise);
        for (Vec3d& value : noise) value = value.cwiseQuotient(squares.cwiseSqrt()) * marram::perlin_rms_3d;
        return noise;
    }();
    return tile;
}

inline double spline(double x) { // B
    const double d = std::abs(x);
    return d <= 0.5 ? 0.75 - d * d : d <= 1.5 ? 0.5 * (1.5 - d) * (1.5 - d) : 0.0;
}

inline Vec3d wavelet_layer(const Vec3d& p, uint32_t seed) {
    const Eigen::Quaterniond turn = Eigen::Quaterniond(7.0, 4.0, 7.0, 15.0).normalized();
    const Vec3d near =
        p.unaryExpr([](double x) { return std::remainder(x, 339.0 * n); }); // exact reduction by the period
    Vec3d q = turn.toRotationMatrix() * near;
    for (int axis = 0; axis < 3; ++axis)
        q[axis] += n * 0x1p-32 * mix32(seed + 0x9e3779b9U * uint32_t(axis + 1));
    const Vec3d base = q.array().floor();
    const Vec3d f = q - base;
    const Tile& tile = wavelet_tile();
    Vec3d sum = Vec3d::Zero();
    for (int k = -1; k <= 2; ++k)
        for (int j = -1; j <= 2; ++j)
            for (int i = -1; i <= 2; ++i)
                sum += spline(f.x() - i) * spline(f.y() - j) * spline(f.z() - k) *
                       tile[cell(int(wrapped(base.x()) & (n - 1)) + i, int(wrapped(base.y()) & (n - 1)) + j,
                                 int(wrapped(base.z()) & (n - 1)) + k)];
    return sum;
}

inline Vec3d wavelet(const Vec3d& p, bool four, double w, uint32_t seed) {
    if (!four) return wavelet_layer(p, seed);
    const double base = std::floor(w), u = quintic(w - base);
    const uint32_t layer = wrapped(base);
    return ((1.0 - u) * wavelet_layer(p, seed ^ (layer * 0x27d4eb2fU)) +
            u * wavelet_layer(p, seed ^ ((layer + 1U) * 0x27d4eb2fU))) /
           std::sqrt(u * u + (1.0 - u) * (1.0 - u));
}

inline Vec3d billow(const Vec3d& p, bool four, double w, uint32_t seed) {
    const double rms = four ? marram::perlin_rms_4d : marram::perlin_rms_3d;
    const double mean = four ? marram::perlin_fold_mean_4d : marram::perlin_fold_mean_3d;
    const Vec3d folded = perlin(p, four, w, seed).cwiseAbs();
    return (folded.array() - mean) * (rms / std::sqrt(rms * rms - mean * mean));
}

inline Vec3d octave(NoiseType type, const Vec3d& p, bool four, double w, uint32_t seed) {
    return type == NoiseType::perlin   ? perlin(p, four, w, seed)
           : type == NoiseType::billow ? billow(p, four, w, seed)
                                       : wavelet(p, four, w, seed);
}

inline Vec3d noise(const FractalNoise& noise, const Vec3d& point, bool four, double w) {
    Vec3d sum = Vec3d::Zero();
    double squares = 0.0, weight = 1.0, frequency = noise.frequency;
    for (int o = 0; o < noise.octaves; ++o) {
        const uint32_t seed = noise.seed + uint32_t(o) * 0x6d2b79f5U;
        sum += weight * octave(noise.type, point * frequency, four, w, seed);
        squares += weight * weight;
        weight *= noise.gain;
        frequency *= noise.lacunarity;
    }
    return sum / std::sqrt(squares);
}

} // namespace reference
