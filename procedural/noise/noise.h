// SPDX-License-Identifier: Apache-2.0
// Vector noise: three independent scalar fields, evaluated at eight points at once.
//
//                rms      range                          smooth  octave with most energy outside  below 1/8
//     perlin     0.270    -1.04 ... 1.04                 C2      0.50 ... 1.00           0.26     4e-4
//     billow     0.270    -0.38 ... 1.42                 C0      0.75 ... 1.50           0.37     2e-3
//     wavelet    0.270    |value| < 2.35 (found: 1.1)    C1      0.31 ... 0.63           0.13     < 1.2e-7
//   with evolution, at a fixed time
//     perlin     0.293    -1.60 ... 1.60 (found: 1.3)    C2      0.44 ... 0.88           0.39     9e-3
//     billow     0.293    -0.41 ... 2.34 (found: 1.8)    C0      0.63 ... 1.25           0.43     3e-3
//     wavelet    0.270    |value| < 3.33 (found: 1.2)    C1      0.31 ... 0.63           0.13     < 1.2e-7
//
// for one component and one octave. All have mean 0. Components are uncorrelated, except for billow: 0.04,
// with evolution 0.02, because all three Perlin components are weak near the same lattice points. The sum
// over octaves is divided by the root of the sum of their squared weights, so that any number of octaves
// keeps the rms.
//
// The last three columns describe the energy spectrum in space, in cycles a cell: the octave [f, 2f] with
// most of the energy, the fraction outside that octave, and the fraction below 1/8. Along a straight line
// every noise has low frequencies: the line's spectrum at f is the integral over the plane k . direction = f.
// Fractions of a line's energy below 1/4 and above 1/2: perlin 0.42 and 0.24, billow 0.29 and 0.45, wavelet
// 0.59 and 0.035. A strand samples noise along lines, where the band of wavelet noise has an upper limit but
// no lower one.
//
// noise_test.cpp and noise_spectrum_test.cpp (tests/unit/noise) print and check these figures, and
// compare the code with noise_reference.h there, which evaluates the definitions below in double precision.
//
// Perlin: gradient noise after K. Perlin, "Improving Noise" (SIGGRAPH 2002). Each lattice point has a random
// gradient, each corner of the point's cell contributes gradient . (point - corner), and the corners are
// blended by the quintic 6t^5 - 15t^4 + 10t^3, whose first and second derivatives vanish at both ends, so the
// field is C2. It is 0 at every lattice point. Gradients are the 12 edge directions of a cube (4 of them
// repeated), in four dimensions the 32 of a hypercube. One hash of a corner serves all three components, each
// using different bits. There is no permutation table: the lattice is hashed, and its period is 2^32 cells.
//
//   hash       H = mix32((h ^ h >> 15) 0x2c1b3c6d + 0xc2b2ae3d k), h = ((0x9e3779b1 i) ^ s) + 3 (0x85ebca77 j), for corner
//              (i, j, k), 32-bit arithmetic, mix32 from core/math/hash.h. Component a uses the bits from 8 a on.
//   seed       s = S in three dimensions; S ^ (0x27d4eb2f l) in layer l of four. S = seed + 0x6d2b79f5 octave.
//   gradient   3-D, four bits: +-first +-second, of the distances (x, y, z) to the corner: the first is x below 8, else
//              y; the second is y below 4, x at 12 and 14, else z. 4-D, five bits: +-a +-b +-c, all of (x, y, z, w) in
//              that order except w below 8, z below 16, y below 24, else x. Bit 0, if set, flips the sign of the first,
//              bit 1 of the second, bit 2 of the third.
//   rms        The squared weights of a cell's corners integrate to A = int f^2 + (1 - f)^2 dt on each axis, and times
//              the squared distance to B = int f^2 (1 - t)^2 + (1 - f)^2 t^2 dt (f: the quintic, t in [0, 1]). Gradients
//              of different corners are independent, their mean squares sum to 2 in 3-D and to 3 in 4-D, so the mean
//              square is 2 A^2 B and 3 A^3 B, with A = 0.783549784, B = 0.059385059.
//
// Billow: the absolute value of each octave of Perlin noise: rounded lobes between creases. Summing absolute
// values is the "turbulence" of K. Perlin, "An Image Synthesizer" (SIGGRAPH 1985); F. K. Musgrave in D. Ebert
// et al., "Texturing and Modeling" uses it for billowy clouds and ridges.
//
//     (|perlin| - mean) rms / sqrt(rms^2 - mean^2)
//
// gives it mean 0 and Perlin's rms: otherwise every octave would add a steady wind along (1, 1, 1). No closed
// form of the mean of |perlin| is known to us; perlin_fold_mean_* are the means of 3 10^9 values (10^9 random
// points, three components) at seed 0, good to +-4e-6; the rms of the same values agrees with the exact one
// above to 3e-6. The field is continuous, with creases where Perlin is 0.
//
// Wavelet: R. Cook & T. DeRose, "Wavelet Noise" (SIGGRAPH 2005), limited to one band of frequencies; see
// wavelet_noise.h. Use it if octaves must not overlap, or if fine ones are left out and must leave no trace.
//
// Accuracy: fractions within a cell are floats computed from a double coordinate; absolute error < 4e-6
// (measured, up to four octaves: perlin 1.7e-6, billow 2.9e-6, wavelet 6e-7) as long as the double coordinate
// is accurate, up to 2^50 cells from the origin. Farther away, where a double resolves less than a quarter of
// a cell, and for infinity, the coordinate is replaced by 0: the value stays finite and in range. The same
// holds for evolution.
//
// To add a type of noise: add it to NoiseType and to "noise.type" in wind.cpp (its choices, and noise_type);
// write one octave of it for eight points, mean 0 and rms perlin_rms_3d, in its own file if it is long; add a
// function next to billow_noise and a case in vector_noise (noise.cpp); describe it above and add it to the
// table. In tests, add its scalar evaluation to noise_reference.h: every test that loops over all types then
// covers it.
#pragma once

#include "core/math/simd.h"

#include <cstdint>

namespace marram {

inline constexpr double perlin_rms_3d = 0.270035082, perlin_rms_4d = 0.292751492;       // of one octave
inline constexpr double perlin_fold_mean_3d = 0.220215, perlin_fold_mean_4d = 0.237737; // mean of |perlin|

enum class NoiseType { perlin, billow, wavelet };

struct FractalNoise {
    NoiseType type = NoiseType::perlin;
    double frequency = 1.0; // cells a metre
    int octaves = 1; // >= 1; `lacunarity` and `gain`: ratios of frequency and weight of successive octaves
    double lacunarity = 2.0;
    double gain = 0.5;
    uint32_t seed = 0;
    int left_out = 0; // number of finest octaves not evaluated; the weights of the others do not change
    // The sum is divided by the root of the sum of squared octave weights: octaves do not change the rms.
};

// out[i] = noise at points[i], which are in metres; `w` is the fourth coordinate in cells (evolution), any
// number, ignored unless `four`. A value depends on its point only, not on the batch. Allocates no memory,
// except for the wavelet tile at its first use. Cost: about 19 ns a vector and octave for every type, 38 with
// `four` (wavelet: 29 and 53), on one core of an EPYC with AVX2; time_of_a_sample prints it.
void vector_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                  Wide3f* out);

} // namespace marram
