// SPDX-License-Identifier: Apache-2.0
// Four floats side by side: the compiler's vector extension at the baseline instruction set, so the bits are the same on
// every processor. a < b gives a mask for a < b ? x : y; v[i] reads and writes one.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

namespace marram {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

inline Float4 min(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 max(Float4 a, Float4 b) { return a > b ? a : b; }
inline Float4 abs(Float4 a) { return max(a, -a); }
inline Float4 sqrt(Float4 a) {
    return Float4{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])};
}
inline float sum(Float4 a) { return (a[0] + a[1]) + (a[2] + a[3]); }

// e^x for x <= 0, infinity included; below -87 it is 0, so that nothing comes out denormal. Error < 2e-7 relative
// (tests/unit/math/test_float4.cpp). x = k ln 2 + r with |r| <= ln 2 / 2, and Taylor's series of e^r.
inline Float4 exp_of_negative(Float4 x) {
    constexpr float least = -87.0F,
                    round_magic = 12582912.0F; // 1.5 * 2^23: adding it rounds to an integer, in the low bits
    const Float4 y = max(x, Float4{} + least);
    const Float4 shifted = y * 1.44269504F + round_magic;
    const Float4 k = shifted - round_magic;
    const Float4 r =
        (y - k * 0.693359375F) - k * -2.12194440e-4F; // ln 2 in two parts, the first of few digits
    Float4 p = r * (1.0F / 5040.0F) + 1.0F / 720.0F;
    p = p * r + 1.0F / 120.0F;
    p = p * r + 1.0F / 24.0F;
    p = p * r + 1.0F / 6.0F;
    p = p * r + 0.5F;
    p = p * r + 1.0F;
    p = p * r + 1.0F;
    Int4 bits;
    std::memcpy(&bits, &shifted, sizeof bits);
    bits = (bits - 0x4b400000 + 127) << 23; // 2^k
    Float4 scale;
    std::memcpy(&scale, &bits, sizeof scale);
    return x < least ? Float4{} : p * scale;
}

// atan2(y, x) without branches to be mispredicted; the error is below 4e-7 radians (tests/unit/math/test_float4.cpp), 0 at (0, 0).
// The arc tangent of 0 ... 1: Abramowitz and Stegun 4.4.49, error 2e-8.
inline float fast_atan2(float y, float x) {
    const float across = std::abs(x), up = std::abs(y);
    const float most = across > up ? across : up, least = across > up ? up : across;
    const float t = most > 0.0F ? least / most : 0.0F, u = t * t, v = u * u, w = v * v;
    const float low = (1.0F - 0.3333314528F * u) + v * (0.1999355085F - 0.1420889944F * u);
    const float high = (0.1065626393F - 0.0752896400F * u) + v * (0.0429096138F - 0.0161657367F * u);
    constexpr float half_pi = 1.57079633F, all_pi = 3.14159265F;
    float angle = t * (low + w * (high + w * 0.0028662257F));
    angle = up > across ? half_pi - angle : angle;
    angle = x < 0.0F ? all_pi - angle : angle;
    return std::copysign(angle, y);
}

} // namespace marram
