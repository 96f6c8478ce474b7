// SPDX-License-Identifier: Apache-2.0
// Vector noise in doubles, one point at a time, from its definition at the head of procedural/wind/noise.h:
//
// Gradient noise (Perlin 2002) on a lattice of cells. The point's fractions within its cell are t_i in [0,
// 1). Every corner of the cell has a gradient g, one of the 12 edge directions of a cube (four of them twice,
// to make 16); the value is the sum over the corners of g . (point - corner), weighted by the product over
// the axes of fade(t_i) or 1 - fade(t_i), fade(t) = 6t^5 - 15t^4 + 10t^3. In four dimensions the gradients
// are the 32 edge directions of a hypercube. One hash of a corner serves the three components, which take its
// bits from 0, 8 and 16 on.
//
// The fractal sum adds octaves, each `lacunarity` finer and `gain` weaker than the one before, and is divided
// by the root of the sum of squared weights. The fourth coordinate (evolution, in cells) is the same in every
// octave.
//
// Billow and wavelet noise and gusts: each in a file of its own beside this one, once their definitions are
// fixed.
#pragma once

#include "core/math/vec.h"

#include <cstdint>

namespace marram::oracle {

struct Fractal {
    double frequency = 1.0; // cells a metre
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
