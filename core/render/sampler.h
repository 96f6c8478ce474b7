// SPDX-License-Identifier: Apache-2.0
// Well-spread sample numbers: Sobol's (0,2)-sequence, Owen-scrambled by hashing, padded two dimensions at a
// time.
//
// Sobol, 1967: two dimensions with generator matrices I and Pascal's triangle modulo 2. Any 2^k points that
// begin at a multiple of 2^k fall one into each of the 2^k elementary intervals of every shape. By Lucas'
// theorem C(j, i) is odd where i's bits are among j's, so the second matrix is a sum over supersets of bit
// positions: five exchanges, no table.
//
// Owen, 1995: nested uniform scrambling flips each bit by a random function of the bits above it; strata
// stay, the error of a smooth integrand falls like n^-1.5 instead of n^-1. Laine and Karras, 2011: on the
// reversed bits that is a hash in which information travels upwards only. Burley, "Practical Hash-based Owen
// Scrambling", JCGT 2020: scrambling the index as well (another seed for every pair) decorrelates the pairs.
// Constants: Vegdahl's, better avalanche than Laine and Karras' own.
#pragma once

#include "core/math/hash.h"
#include "core/math/vec.h"

namespace marram {

constexpr uint32_t reverse_bits(uint32_t x) {
    x = __builtin_bswap32(x);
    x = ((x & 0x0f0f0f0fU) << 4) | ((x >> 4) & 0x0f0f0f0fU);
    x = ((x & 0x33333333U) << 2) | ((x >> 2) & 0x33333333U);
    return ((x & 0x55555555U) << 1) | ((x >> 1) & 0x55555555U);
}

// Scrambles a number whose most significant bit stands lowest.
constexpr uint32_t scramble_reversed(uint32_t x, uint32_t seed) {
    x ^= x * 0x3d20adeaU;
    x += seed;
    x *= (seed >> 16) | 1U;
    x ^= x * 0x05526c56U;
    x ^= x * 0x53a22864U;
    return x;
}

constexpr uint32_t nested_uniform_scramble(uint32_t x, uint32_t seed) {
    return reverse_bits(scramble_reversed(reverse_bits(x), seed));
}

// The second dimension of point `index`, bits reversed; the first dimension reversed is the index itself.
constexpr uint32_t sobol_second_reversed(uint32_t index) {
    index ^= (index >> 1) & 0x55555555U;
    index ^= (index >> 2) & 0x33333333U;
    index ^= (index >> 4) & 0x0f0f0f0fU;
    index ^= (index >> 8) & 0x00ff00ffU;
    index ^= (index >> 16) & 0x0000ffffU;
    return index;
}

// The numbers of one sample of one pixel, pair after pair. Two samplers that are alike in seed, pixel and
// sample give the same numbers.
class Sampler {
  public:
    Sampler(uint64_t pixel_seed, uint32_t sample) : seed_(pixel_seed), sample_(sample) {}

    // Where the next pair is taken from: callers give every purpose its own place, whatever was drawn before.
    void seek(uint32_t pair) { pair_ = pair; }

    Vec2f next_pair() {
        const uint64_t key = hash(seed_, pair_++);
        const uint32_t low = static_cast<uint32_t>(key), high = static_cast<uint32_t>(key >> 32);
        const uint32_t index = nested_uniform_scramble(sample_, low);
        const uint32_t x = scramble_reversed(index, high);
        const uint32_t y = scramble_reversed(sobol_second_reversed(index), mix32(low ^ high));
        return {unit_float(reverse_bits(x)), unit_float(reverse_bits(y))};
    }

  private:
    uint64_t seed_;
    uint32_t sample_;
    uint32_t pair_ = 0;
};

// The seed of a pixel's sequence in a frame.
constexpr uint64_t pixel_seed(uint64_t frame_seed, uint32_t x, uint32_t y) {
    return hash(frame_seed, (static_cast<uint64_t>(y) << 32) | x);
}

} // namespace marram
