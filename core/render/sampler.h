// SPDX-License-Identifier: Apache-2.0
// Low-discrepancy sampler: four-dimensional Sobol points with hash-based Owen scrambling, padded in sets of
// four.
//
// Sobol, 1967, with Joe and Kuo's direction numbers. Of any 2^k points that begin at a multiple of 2^k,
// exactly one lies in each of the 2^k elementary intervals (of every shape) of the first two dimensions; all
// four dimensions together need 8 times as many points. The generator matrix of the first dimension is I,
// that of the second is Pascal's triangle modulo 2. By Lucas' theorem C(j, i) is odd if the bits of i are a
// subset of those of j, so the second dimension is a sum over supersets of bit positions, computed in five
// steps. The other two dimensions are sums of table entries, one for each byte of the index.
//
// Owen, 1995: nested uniform scrambling flips each bit by a random function of the higher bits. It preserves
// strata, and the error of a smooth integrand falls like n^-1.5 instead of n^-1. Laine and Karras, 2011: on
// the reversed bits this is a hash in which information only travels upwards. The constants are Vegdahl's,
// which have better avalanche than those of Laine and Karras.
//
// Padding: the order of points is shuffled independently in each set, otherwise sets would be correlated.
// Owen scrambling of the index, as in Burley, "Practical Hash-based Owen Scrambling", JCGT 2020, keeps points
// 2k and 2k + 1 neighbours in every set. They are opposite in all dimensions, so products over two sets have
// 1.5 to 1.7 times the variance of independent samples. Here the points of each aligned block of 16 are
// permuted by i -> a i + b over the field of 16 elements, with random a (not 0) and b: any two positions are
// mapped to any other two equally often, and the variance of products is 16/15. Strata of 16 and more points
// are preserved. Set 0 keeps its order, and so all its strata.
#pragma once

#include "core/math/float4.h"
#include "core/math/hash.h"

#include <array>

namespace marram {

// T: uint32_t or UInt4.
template <typename T>
constexpr T reverse_bits(T x) {
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffU) << 8) | ((x >> 8) & 0x00ff00ffU);
    x = ((x & 0x0f0f0f0fU) << 4) | ((x >> 4) & 0x0f0f0f0fU);
    x = ((x & 0x33333333U) << 2) | ((x >> 2) & 0x33333333U);
    return ((x & 0x55555555U) << 1) | ((x >> 1) & 0x55555555U);
}

// Owen scrambling of bit-reversed numbers.
constexpr UInt4 scramble_reversed(UInt4 x, UInt4 seed) {
    x ^= x * 0x3d20adeaU;
    x += seed;
    x *= (seed >> 16) | 1U;
    x ^= x * 0x05526c56U;
    x ^= x * 0x53a22864U;
    return x;
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

// The third and fourth dimension, bits reversed: contribution of each value of each byte of the index.
struct SobolBytes {
    std::array<std::array<std::array<uint32_t, 2>, 256>, 4> sums{};

    constexpr SobolBytes() {
        std::array<uint32_t, 32> third{1, 3}, fourth{1, 3, 1}; // x^2 + x + 1, x^3 + x + 1
        for (size_t i = 2; i < 32; ++i) third[i] = 2 * third[i - 1] ^ 4 * third[i - 2] ^ third[i - 2];
        for (size_t i = 3; i < 32; ++i) fourth[i] = 4 * fourth[i - 2] ^ 8 * fourth[i - 3] ^ fourth[i - 3];
        for (size_t bit = 0; bit < 32; ++bit) {
            const std::array<uint32_t, 2> column = {reverse_bits(third[bit] << (31 - bit)),
                                                    reverse_bits(fourth[bit] << (31 - bit))};
            for (size_t value = 0; value < 256; ++value)
                if (value >> (bit % 8) & 1U)
                    for (size_t d = 0; d < 2; ++d) sums[bit / 8][value][d] ^= column[d];
        }
    }
};
inline constexpr SobolBytes sobol_bytes;

// [a]: the products a i over the field of 16 elements (x^4 + x + 1), four bits each.
struct FieldProducts {
    std::array<uint64_t, 16> rows{};

    constexpr FieldProducts() {
        for (uint32_t a = 0; a < 16; ++a)
            for (uint32_t i = 0; i < 16; ++i) {
                uint32_t product = 0;
                for (uint32_t bit = 0; bit < 4; ++bit) product ^= (i >> bit & 1U) * (a << bit);
                for (uint32_t bit = 6; bit >= 4; --bit)
                    product ^= (product >> bit & 1U) * (0x13U << (bit - 4));
                rows[a] |= uint64_t(product) << (4 * i);
            }
    }
};
inline constexpr FieldProducts field_products;

// Permutes a point within its block of 16: a i + b.
constexpr uint32_t shuffle_sixteen(uint32_t index, uint32_t seed) {
    const uint32_t random = mix32(seed ^ (index >> 4)), a = 1 + ((random >> 16) * 15 >> 16), b = random & 15U;
    return (index & ~15U) | ((uint32_t(field_products.rows[a] >> (4 * (index & 15U))) & 15U) ^ b);
}

// The random numbers of one sample of one pixel, four at a time. They depend on seed, pixel and sample only.
class Sampler {
  public:
    Sampler(uint64_t pixel_seed, uint32_t sample) : seed_(pixel_seed), sample_(sample) {}

    // Each use has its own set, independent of the others. Within a set the first two numbers are stratified
    // best, the fourth worst.
    std::array<float, 4> get_4d(uint32_t set) const {
        const uint64_t a = mix64(seed_ + first_step * (set + 1)), b = mix64(seed_ - second_step * (set + 1));
        const UInt4 seeds{uint32_t(a), uint32_t(a >> 32), uint32_t(b), uint32_t(b >> 32)};
        const uint32_t index = set == 0 ? sample_ : shuffle_sixteen(sample_, seeds[0] ^ seeds[3]);
        UInt4 point{index, sobol_second_reversed(index), 0, 0};
        for (uint32_t left = index, byte = 0; left > 0; left >>= 8, ++byte) {
            const auto& sum = sobol_bytes.sums[byte][left & 255U];
            point ^= UInt4{0, 0, sum[0], sum[1]};
        }
        const UInt4 bits = reverse_bits(scramble_reversed(point, seeds));
        return {unit_float(bits[0]), unit_float(bits[1]), unit_float(bits[2]), unit_float(bits[3])};
    }

  private:
    // Odd, from the golden ratio and the square root of 3: no small multiple of one is close to one of the
    // other.
    static constexpr uint64_t first_step = 0x9e3779b97f4a7c15ULL, second_step = 0xbb67ae8584caa73bULL;
    uint64_t seed_;
    uint32_t sample_;
};

// The seed of a pixel's sequence in a frame.
constexpr uint64_t pixel_seed(uint64_t frame_seed, uint32_t x, uint32_t y) {
    return hash(frame_seed, (static_cast<uint64_t>(y) << 32) | x);
}

} // namespace marram
