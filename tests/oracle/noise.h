// SPDX-License-Identifier: Apache-2.0
// Vector noise in doubles, one point at a time, from its definition at the head of procedural/noise/noise.h:
//
// Gradient noise (Perlin 2002) on a lattice of cells. The fractional coordinates of the point in its cell are
// t_i in [0, 1). Every corner of the cell has a gradient g, one of the 12 edge directions of a cube (four of
// them twice, to make 16). The value is the sum over the corners of g . (point - corner), weighted by the
// product over the axes of fade(t_i) or 1 - fade(t_i), fade(t) = 6t^5 - 15t^4 + 10t^3. In four dimensions the
// gradients are the 32 edge directions of a hypercube. The three components share one hash per corner and use
// its bits from 0, 8 and 16 on.
//
// The fractal sum adds octaves, each with `lacunarity` times the frequency and `gain` times the weight of the
// one before, and divides by the square root of the sum of squared weights. The fourth coordinate (evolution,
// in cells) is the same in every octave.
//
// Billow noise, wavelet noise and gusts are not covered.
#pragma once

#include "core/math/vec.h"

#include <cstdint>

namespace marram::oracle {

struct Fractal {
    double frequency = 1.0; // cells per metre
    int octaves = 1;
    double lacunarity = 2.0;
    double gain = 0.5;
    uint32_t seed = 0;
};

// One octave at a point in cells. Error: a few roundings of the fractions, 1e-15 near the origin.
Vec3d perlin(const Vec3d& cells, uint32_t seed);
Vec3d perlin(const Vec3d& cells, double fourth, uint32_t seed);

Vec3d fractal_noise(const Fractal& noise, const Vec3d& metres);
Vec3d fractal_noise(const Fractal& noise, const Vec3d& metres, double fourth);

} // namespace marram::oracle
