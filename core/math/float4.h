// SPDX-License-Identifier: Apache-2.0
// Four floats in one SIMD register: the compiler's vector extension at the baseline instruction set, so the
// results are the same to the bit on every processor. a < b is a mask for a < b ? x : y; v[i] reads and
// writes one lane.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

namespace marram {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));
using UInt4 = uint32_t __attribute__((vector_size(16)));

inline Float4 min(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 max(Float4 a, Float4 b) { return a > b ? a : b; }
inline Float4 abs(Float4 a) { return max(a, -a); }
inline Float4 sqrt(Float4 a) {
    return Float4{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])};
}
inline float sum(Float4 a) { return (a[0] + a[1]) + (a[2] + a[3]); }

// Rounds to the nearest integer, halves to even, for |x| < 2^22: adding 1.5 * 2^23 leaves no fraction bits.
constexpr float no_fraction = 12582912.0F;
inline Float4 round(Float4 x) { return (x + no_fraction) - no_fraction; }

// e^x for x <= 0, including -infinity. Below -87 the result is 0, so that it is never denormal. Relative
// error < 2e-7 (tests/unit/math/test_float4.cpp). x = k ln 2 + r with |r| <= ln 2 / 2, and the Taylor
// series of e^r.
inline Float4 exp_of_negative(Float4 x) {
    constexpr float least = -87.0F;
    const Float4 y = max(x, Float4{} + least);
    const Float4 shifted = y * 1.44269504F + no_fraction; // k is in the low bits
    const Float4 k = shifted - no_fraction;
    const Float4 r = (y - k * 0.693359375F) - k * -2.12194440e-4F; // ln 2 in two parts, the first of few bits
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

// sin x and cos x for |x| <= 100, error < 2e-7 (tests/unit/math/test_float4.cpp). x = k pi / 2 + r with
// |r| <= pi / 4, and minimax polynomials of r (Cephes).
inline void fast_sin_cos(Float4 x, Float4& sine, Float4& cosine) {
    const Float4 shifted = x * 0.636619772F + no_fraction;
    const Float4 k = shifted - no_fraction;
    // pi / 2 in three parts, the first two with few bits
    const Float4 r = ((x - k * 1.5703125F) - k * 4.837512969970703125e-4F) - k * 7.549789948768648e-8F;
    const Float4 r2 = r * r;
    const Float4 s = r + r * r2 * ((-1.9515295891e-4F * r2 + 8.3321608736e-3F) * r2 - 1.6666654611e-1F);
    const Float4 c =
        (1.0F - 0.5F * r2) +
        r2 * r2 * ((2.443315711809948e-5F * r2 - 1.388731625493765e-3F) * r2 + 4.166664568298827e-2F);
    Int4 quarter;
    std::memcpy(&quarter, &shifted, sizeof quarter);
    const Int4 odd = (quarter & 1) != 0;
    sine = odd ? c : s;
    cosine = odd ? s : c;
    sine = (quarter & 2) != 0 ? -sine : sine;
    cosine = ((quarter + 1) & 2) != 0 ? -cosine : cosine;
}

// Branchless atan2(y, x), error < 4e-7 radians (tests/unit/math/test_float4.cpp); 0 at (0, 0). The arc
// tangent on 0 ... 1: Abramowitz and Stegun 4.4.49, error 2e-8.
inline Float4 fast_atan2(Float4 y, Float4 x) {
    const Float4 across = abs(x), up = abs(y);
    const Float4 most = max(across, up), least = min(across, up);
    const Float4 t = most > 0.0F ? least / most : Float4{}, u = t * t, v = u * u, w = v * v;
    const Float4 low = (1.0F - 0.3333314528F * u) + v * (0.1999355085F - 0.1420889944F * u);
    const Float4 high = (0.1065626393F - 0.0752896400F * u) + v * (0.0429096138F - 0.0161657367F * u);
    constexpr float half_pi = 1.57079633F, all_pi = 3.14159265F;
    Float4 angle = t * (low + w * (high + w * 0.0028662257F));
    angle = up > across ? half_pi - angle : angle;
    angle = x < 0.0F ? all_pi - angle : angle;
    return y < 0.0F ? -angle : angle;
}

inline float fast_atan2(float y, float x) { return fast_atan2(Float4{} + y, Float4{} + x)[0]; }

} // namespace marram
