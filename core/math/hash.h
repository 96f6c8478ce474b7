// SPDX-License-Identifier: Apache-2.0
// Random numbers by hashing (seed, what, purpose). No generator has a state, so adding a parameter or a
// thread does not change the other random numbers.
//
// mix32 is Wellons' "lowbias32" (bias 0.17), mix64 is Stafford's variant 13 of the MurmurHash3 finaliser.
#pragma once

#include <cstdint>

namespace marram {

constexpr uint32_t mix32(uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352dU;
    x ^= x >> 15;
    x *= 0x846ca68bU;
    x ^= x >> 16;
    return x;
}

constexpr uint64_t mix64(uint64_t x) {
    x ^= x >> 30;
    x *= 0xbf58476d1ce4e5b9ULL;
    x ^= x >> 27;
    x *= 0x94d049bb133111ebULL;
    x ^= x >> 31;
    return x;
}

// A hash of two words. Chain it for more: hash(hash(seed, id), purpose).
constexpr uint64_t hash(uint64_t a, uint64_t b) { return mix64(mix64(a + 0x9e3779b97f4a7c15ULL) ^ b); }

// The top bits of a hash as a number in [0, 1): 24 bits for float, 53 for double, so it never rounds to 1.
constexpr float unit_float(uint32_t h) { return static_cast<float>(h >> 8) * 0x1p-24F; }
constexpr double unit_double(uint64_t h) { return static_cast<double>(h >> 11) * 0x1p-53; }

} // namespace marram
