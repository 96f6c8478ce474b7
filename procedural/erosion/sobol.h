// SPDX-License-Identifier: Apache-2.0
// Owen-scrambled Sobol sequence in five dimensions. Stateless: any point by its index.
//
// Direction numbers of S. Joe and F. Kuo, "Constructing Sobol sequences with better two-dimensional
// projections", SIAM J. Sci. Comput. 2008. Nested uniform scrambling by a hash of the reversed bits: B.
// Burley, "Practical hash-based Owen scrambling", JCGT 2020.
#pragma once

#include "core/math/simd.h"

#include <array>
#include <cstdint>

namespace marram {

// V: uint32_t, or VUint for eight at a time.
template <typename V>
MARRAM_INLINE constexpr V reversed_bits(V x) {
    x = ((x >> 1) & 0x55555555U) | ((x & 0x55555555U) << 1);
    x = ((x >> 2) & 0x33333333U) | ((x & 0x33333333U) << 2);
    x = ((x >> 4) & 0x0f0f0f0fU) | ((x & 0x0f0f0f0fU) << 4);
    x = ((x >> 8) & 0x00ff00ffU) | ((x & 0x00ff00ffU) << 8);
    return (x >> 16) | (x << 16);
}

// Permutes the 2^32 numbers such that aligned blocks of power-of-two size are kept. Used to shuffle indices,
// and for the Owen scrambling of a coordinate's bits.
template <typename V, typename Seed>
MARRAM_INLINE constexpr V owen_shuffle(V x, Seed seed) {
    x = reversed_bits(x);
    x += seed;
    x ^= x * 0x6c50b47cU;
    x ^= x * 0xb82f1e52U;
    x ^= x * 0xc7afe638U;
    x ^= x * 0x8d22f6e6U;
    return reversed_bits(x);
}

// Dimension 1, without tables. Reversed, direction number k is the polynomial (1 + x)^k over GF(2), so a
// point is its index at 1 + x, which halving finds: (1 + x)^16 = 1 + x^16.
template <typename V>
MARRAM_INLINE constexpr V sobol_1(V index) {
    index ^= (index >> 16) & 0x0000ffffU;
    index ^= (index >> 8) & 0x00ff00ffU;
    index ^= (index >> 4) & 0x0f0f0f0fU;
    index ^= (index >> 2) & 0x33333333U;
    index ^= (index >> 1) & 0x55555555U;
    return reversed_bits(index);
}

constexpr std::array<std::array<uint32_t, 32>, 5> sobol_directions() {
    struct Polynomial {
        int degree;
        uint32_t inner; // coefficients between the first and the last
        uint32_t start[3];
    };
    constexpr Polynomial polynomials[4] = {{1, 0, {1}}, {2, 1, {1, 3}}, {3, 1, {1, 3, 1}}, {3, 2, {1, 1, 1}}};
    std::array<std::array<uint32_t, 32>, 5> v{};
    for (size_t k = 0; k < 32; ++k) v[0][k] = 1U << (31 - k);
    for (size_t d = 1; d < 5; ++d) {
        const Polynomial& p = polynomials[d - 1];
        const auto n = size_t(p.degree);
        for (size_t k = 0; k < n; ++k) v[d][k] = p.start[k] << (31 - k);
        for (size_t k = n; k < 32; ++k) {
            v[d][k] = v[d][k - n] ^ (v[d][k - n] >> n);
            for (size_t j = 1; j < n; ++j)
                if ((p.inner >> (n - 1 - j)) & 1U) v[d][k] ^= v[d][k - j];
        }
    }
    return v;
}

// The directions of each byte of an index, combined.
using SobolBytes = std::array<std::array<uint32_t, 256>, 4>;
constexpr std::array<SobolBytes, 5> sobol_bytes() {
    const auto directions = sobol_directions();
    std::array<SobolBytes, 5> sums{};
    for (size_t d = 0; d < 5; ++d)
        for (size_t byte = 0; byte < 4; ++byte)
            for (size_t k = 0; k < 8; ++k)
                for (size_t value = 0; value < size_t{1} << k; ++value)
                    sums[d][byte][(size_t{1} << k) + value] =
                        sums[d][byte][value] ^ directions[d][8 * byte + k];
    return sums;
}

// Coordinate `dimension` (0 to 4) of a point, times 2^32.
inline uint32_t sobol_bits(uint32_t index, int dimension) {
    static constexpr std::array<SobolBytes, 5> sums = sobol_bytes();
    const SobolBytes& of = sums[size_t(dimension)];
    return of[0][index & 255U] ^ of[1][index >> 8 & 255U] ^ of[2][index >> 16 & 255U] ^ of[3][index >> 24];
}

// The coordinate, scrambled, in [0, 1).
inline double sobol_point(uint32_t index, int dimension, uint32_t seed) {
    return double(owen_shuffle(sobol_bits(index, dimension), seed)) * 0x1p-32;
}

} // namespace marram
