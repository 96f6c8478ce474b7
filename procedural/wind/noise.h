// SPDX-License-Identifier: Apache-2.0
// Vector noise: three independent scalar fields at once, for eight points at once.
//
// Gradient noise after K. Perlin, "Improving Noise" (SIGGRAPH 2002): at each lattice point a gradient is drawn, each
// corner of the point's cell contributes gradient . (point - corner), and the corners are blended by the quintic
// 6t^5 - 15t^4 + 10t^3, whose first and second derivatives vanish at both ends, so the field is C2. Gradients are the 12
// edge directions of a cube (with 4 repeated), in four dimensions the 32 of a hypercube. One hash of a corner serves all
// three components, which take different bits of it. The lattice is hashed, not tabulated: its period is 2^32 cells.
//
// Facts (tests/unit/procedural/noise_test.cpp prints and bounds them): value 0 at every lattice point; |value| <= 1.04 a
// component in 3-D; mean 0; C2. Fractions within a cell are floats of a double coordinate: error < 1e-6 absolute
// wherever the double coordinate itself is good, up to 2^50 cells from the origin.
//
// To add a type of noise: add its function here, its name to NoiseType and to the switch in noise.cpp.
#pragma once

#include "procedural/simd.h"

#include <cstdint>

namespace marram {

struct FractalNoise {
    double frequency = 1.0; // cells a metre
    int octaves = 1;        // >= 1; each finer by `lacunarity` and weaker by `gain`
    double lacunarity = 2.0;
    double gain = 0.5;
    uint32_t seed = 0;
    // The sum is divided by the root of the sum of squared octave weights: octaves change the look, not the strength.
};

// out = noise at `p` metres; `w` is the fourth coordinate in cells (evolution), ignored unless `four`. Both are reduced
// to the lattice's period by the caller if they may exceed 2^50.
void vector_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                  Wide3f* out);

} // namespace marram
