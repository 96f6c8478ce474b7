// SPDX-License-Identifier: Apache-2.0
// Vector noise: three independent scalar fields at once, for eight points at once.
//
//                rms      range                          smooth  octave that holds most  outside  below 1/8
//     perlin     0.270    -1.04 ... 1.04                 C2      0.50 ... 1.00           0.26     4e-4
//     billow     0.270    -0.38 ... 1.42                 C0      0.75 ... 1.50           0.37     2e-3
//     wavelet    0.270    |value| < 2.35 (seen: 1.1)     C1      0.31 ... 0.63           0.13     < 1.2e-7
//   with evolution, at one moment
//     perlin     0.293    -1.60 ... 1.60 (seen: 1.3)     C2      0.44 ... 0.88           0.39     9e-3
//     billow     0.293    -0.41 ... 2.34 (seen: 1.8)     C0      0.63 ... 1.25           0.43     3e-3
//     wavelet    0.270    |value| < 3.33 (seen: 1.2)     C1      0.31 ... 0.63           0.13     < 1.2e-7
//
// of a component, for one octave. All have mean 0. Components are uncorrelated, but for billow's: 0.04, with evolution 0.02,
// because all three Perlin components are weak near the same lattice points. The sum over octaves is divided by the root of
// the sum of their squared weights, so that any number of octaves keeps the rms.
//
// The last three columns are energy in space, in cycles a cell: the octave [f, 2f] that holds most of it, the share outside
// of that octave, and the share below 1/8. On a straight line every noise has low frequencies: at f the line sees all that
// the spectrum holds in the plane f . direction = f. Of a line's energy lie below 1/4 and above 1/2: perlin 0.42 and 0.24,
// billow 0.29 and 0.45, wavelet 0.59 and 0.035. A strand samples lines; there wavelet noise's band has an upper end, but
// no lower one.
//
// noise_test.cpp and noise_spectrum_test.cpp (tests/unit/procedural) print and bound all this, and hold the code against
// noise_reference.h there, which evaluates the definitions below in double precision.
//
// Perlin: gradient noise after K. Perlin, "Improving Noise" (SIGGRAPH 2002). At each lattice point a gradient is drawn, each
// corner of the point's cell contributes gradient . (point - corner), and the corners are blended by the quintic
// 6t^5 - 15t^4 + 10t^3, whose first and second derivatives vanish at both ends, so the field is C2. It is 0 at every lattice
// point. Gradients are the 12 edge directions of a cube (with 4 repeated), in four dimensions the 32 of a hypercube. One
// hash of a corner serves all three components, which take different bits of it. The lattice is hashed, not tabulated: its
// period is 2^32 cells.
//
//   hash       H = mix32((h ^ h >> 15) 0x2c1b3c6d + 0xc2b2ae3d k), h = ((0x9e3779b1 i) ^ s) + 3 (0x85ebca77 j), of corner
//              (i, j, k), 32-bit arithmetic, mix32 of core/math/hash.h. Component a takes the bits from 8 a on.
//   seed       s = S in three dimensions; S ^ (0x27d4eb2f l) in layer l of four. S = seed + 0x6d2b79f5 octave.
//   gradient   3-D, four bits: +-first +-second, of the distances (x, y, z) to the corner: the first is x below 8, else
//              y; the second is y below 4, x at 12 and 14, else z. 4-D, five bits: +-a +-b +-c, all of (x, y, z, w) in
//              that order but w below 8, z below 16, y below 24, else x. Bit 0, where set, turns the sign of the first,
//              bit 1 of the second, bit 2 of the third.
//   rms        The squared weights of a cell's corners integrate to A = int f^2 + (1 - f)^2 dt on each axis, and times
//              the squared distance to B = int f^2 (1 - t)^2 + (1 - f)^2 t^2 dt (f: the quintic, t in [0, 1]). Different
//              corners' gradients are independent, their mean squares sum to 2 in 3-D and to 3 in 4-D, so the mean square
//              is 2 A^2 B and 3 A^3 B, with A = 0.783549784, B = 0.059385059.
//
// Billow: the Perlin noise of each octave folded at 0: rounded heaps between creases. The folded octaves are the
// "turbulence" of K. Perlin, "An Image Synthesizer" (SIGGRAPH 1985); F. K. Musgrave in D. Ebert et al.,
// "Texturing and Modeling" builds billowy clouds and ridges of them.
//
//     (|perlin| - mean) rms / sqrt(rms^2 - mean^2)
//
// so that it too has mean 0 and Perlin's rms: without that, every octave would add a steady wind along (1, 1, 1). The mean of
// |perlin| has no closed form that we know of; perlin_fold_mean_* are the means of 3 10^9 values (10^9 random points,
// three components) at seed 0, good to +-4e-6, and the rms of the same values met the exact one above within 3e-6. It is
// continuous, with creases where Perlin is 0.
//
// Wavelet: R. Cook & T. DeRose, "Wavelet Noise" (SIGGRAPH 2005), one band of frequencies; see wavelet_noise.h. It is the one
// to take where octaves must not blur into each other, or fine ones be left out without a trace.
//
// Accuracy: fractions within a cell are floats of a double coordinate; error < 4e-6 absolute (measured, up to four
// octaves: perlin 1.7e-6, billow 2.9e-6, wavelet 6e-7) wherever the double coordinate itself is good, up to 2^50 cells from
// the origin. Beyond, where a double has no fraction worth the name, and for
// infinity, the coordinate is taken as 0: the value stays finite and in range. Evolution's likewise.
//
// To add a type of noise: name it in NoiseType and in the "noise.type" of wind.cpp (its choices, and noise_type); write one
// octave of it for eight points, mean 0 and rms perlin_rms_3d, in a file of its own if it is long; give it a function beside
// billow_noise and a case in vector_noise (noise.cpp); say above what it is and add it to the table. In tests, add its
// scalar evaluation to noise_reference.h: every test that goes through all types then covers it.
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
    int octaves = 1;        // >= 1; each finer by `lacunarity` and weaker by `gain`
    double lacunarity = 2.0;
    double gain = 0.5;
    uint32_t seed = 0;
    int left_out = 0; // of the finest octaves, not evaluated; the others are as strong as beside them
    // The sum is divided by the root of the sum of squared octave weights: octaves change the look, not the strength.
};

// out[i] = noise at points[i], in metres; `w` is the fourth coordinate in cells (evolution), any number, ignored unless
// `four`. A value depends on its point only, not on the batch. Nothing is allocated, but for the wavelet's tile at its very
// first use. Costs about 19 ns a vector and octave of any type, 38 with `four` (wavelet: 29 and 53), on one core of an EPYC
// with AVX2; time_of_a_sample prints it.
void vector_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                  Wide3f* out);

} // namespace marram
