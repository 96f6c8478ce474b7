// SPDX-License-Identifier: Apache-2.0
// Eight strands side by side. The types are GCC's vectors of 32 bytes, one AVX2 register each. GCC 12 compiles comparisons and
// selections of wider vectors lane by lane where there is no AVX-512, which is three times slower.
// One source serves SSE2 and AVX2. Nothing is contracted or reassociated (-ffp-contract=off), so both give the same bits
// (Simd.InstructionSetsAgree). A variant for AVX-512 was measured: 0 to 5 % faster on a Zen 4, for an eighth more build time.
//
// A hot function is marked MARRAM_HOT: it is compiled once for each instruction set and the loader picks one
// at start-up. Everything it calls must be MARRAM_INLINE, or it would run in its baseline version.
//
// The elementary functions below are polynomials valid on the stated domain only; their errors are bounded by
// tests/unit/math/simd_test.cpp over 10^5 to 10^6 points each.
#pragma once

#include <tbb/cache_aligned_allocator.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace marram {

inline constexpr int lanes = 8;

#define MARRAM_INLINE __attribute__((always_inline)) inline
#define MARRAM_ALWAYS_INLINE __attribute__((always_inline)) // of a lambda
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)
// Sanitizers run before the loader has resolved clones, so sanitized builds do without.
#define MARRAM_HOT __attribute__((target_clones("default", "arch=x86-64-v3"), flatten))
#else
#define MARRAM_HOT
#endif

// Aligned by hand: the baseline aligns wide vectors to 16 bytes only, but the clones expect their full width.
// A template argument loses the attribute, so memory that clones see is a struct that says alignas, or a
// WideVector.
using VFloat = float __attribute__((vector_size(lanes * 4), aligned(lanes * 4)));
using VInt = int32_t __attribute__((vector_size(lanes * 4), aligned(lanes * 4)));
using VUint = uint32_t __attribute__((vector_size(lanes * 4), aligned(lanes * 4)));
using Double4 = double __attribute__((vector_size(32), aligned(32)));
using Long4 = int64_t __attribute__((vector_size(32), aligned(32)));

// Eight doubles or 64-bit integers, as two vectors of four. A comparison gives a mask for select(): each lane
// is -1 or 0. The struct is aligned because a template argument loses the alignment of its type.
template <typename T, typename Piece>
struct alignas(64) Eight {
    Piece half[2];

    MARRAM_INLINE static Eight splat(T x) { return {Piece{x, x, x, x}, Piece{x, x, x, x}}; }
    MARRAM_INLINE T operator[](int lane) const { return half[lane >> 2][lane & 3]; }
    // A vector may alias its lanes in GCC. Goes through memory: not for inner loops.
    MARRAM_INLINE T& operator[](int lane) { return reinterpret_cast<T*>(half)[lane]; }
};
using VDouble = Eight<double, Double4>;
using VLong = Eight<int64_t, Long4>;

MARRAM_INLINE VDouble splat(double x) { return VDouble::splat(x); }
MARRAM_INLINE VFloat splat_float(float x) { return VFloat{x, x, x, x, x, x, x, x}; } // 0 + x would lose -0
inline constexpr VLong all_lanes = {{{-1, -1, -1, -1}, {-1, -1, -1, -1}}}; // the mask that selects all
inline constexpr VLong lane_index = {{{0, 1, 2, 3}, {4, 5, 6, 7}}};
inline constexpr VDouble lane_index_double = {{{0, 1, 2, 3}, {4, 5, 6, 7}}};

#define MARRAM_ELEMENTWISE(Result, V, T, op)                                                                 \
    MARRAM_INLINE Result operator op(const V& a, const V& b) {                                               \
        return {a.half[0] op b.half[0], a.half[1] op b.half[1]};                                             \
    }                                                                                                        \
    MARRAM_INLINE Result operator op(const V& a, T b) { return a op V::splat(b); }                           \
    MARRAM_INLINE Result operator op(T a, const V& b) { return V::splat(a) op b; }
#define MARRAM_ARITHMETIC(V, T, op)                                                                          \
    MARRAM_ELEMENTWISE(V, V, T, op)                                                                          \
    MARRAM_INLINE V& operator op##=(V& a, const V& b) { return a = a op b; }                                 \
    MARRAM_INLINE V& operator op##=(V& a, T b) { return a = a op b; }
MARRAM_ARITHMETIC(VDouble, double, +)
MARRAM_ARITHMETIC(VDouble, double, -)
MARRAM_ARITHMETIC(VDouble, double, *)
MARRAM_ARITHMETIC(VDouble, double, /)
MARRAM_ARITHMETIC(VLong, int64_t, +)
MARRAM_ARITHMETIC(VLong, int64_t, -)
MARRAM_ARITHMETIC(VLong, int64_t, &)
MARRAM_ARITHMETIC(VLong, int64_t, |)
MARRAM_ARITHMETIC(VLong, int64_t, ^)
MARRAM_ELEMENTWISE(VLong, VDouble, double, <)
MARRAM_ELEMENTWISE(VLong, VDouble, double, <=)
MARRAM_ELEMENTWISE(VLong, VDouble, double, >)
MARRAM_ELEMENTWISE(VLong, VDouble, double, >=)
MARRAM_ELEMENTWISE(VLong, VDouble, double, ==)
MARRAM_ELEMENTWISE(VLong, VDouble, double, !=)
MARRAM_ELEMENTWISE(VLong, VLong, int64_t, <)
MARRAM_ELEMENTWISE(VLong, VLong, int64_t, >)
MARRAM_ELEMENTWISE(VLong, VLong, int64_t, ==)
MARRAM_ELEMENTWISE(VLong, VLong, int64_t, !=)
#undef MARRAM_ARITHMETIC
#undef MARRAM_ELEMENTWISE
MARRAM_INLINE VDouble operator-(const VDouble& a) { return {-a.half[0], -a.half[1]}; }
MARRAM_INLINE VLong operator~(const VLong& a) { return {~a.half[0], ~a.half[1]}; }
MARRAM_INLINE VLong operator<<(const VLong& a, int by) { return {a.half[0] << by, a.half[1] << by}; }
MARRAM_INLINE VLong operator>>(const VLong& a, int by) { return {a.half[0] >> by, a.half[1] >> by}; }

// a where the mask is set, else b. Both are computed.
MARRAM_INLINE VDouble select(const VLong& mask, const VDouble& a, const VDouble& b) {
    return {mask.half[0] ? a.half[0] : b.half[0], mask.half[1] ? a.half[1] : b.half[1]};
}
MARRAM_INLINE VDouble select(const VLong& mask, double a, const VDouble& b) {
    return select(mask, splat(a), b);
}
MARRAM_INLINE VDouble select(const VLong& mask, const VDouble& a, double b) {
    return select(mask, a, splat(b));
}
MARRAM_INLINE VDouble select(const VLong& mask, double a, double b) {
    return select(mask, splat(a), splat(b));
}
MARRAM_INLINE VLong select(const VLong& mask, const VLong& a, const VLong& b) {
    return (mask & a) | (~mask & b);
}

template <typename To, typename From>
MARRAM_INLINE To bits_as(const From& from) {
    static_assert(sizeof(To) == sizeof(From));
    To to;
    std::memcpy(&to, &from, sizeof to);
    return to;
}
template <>
MARRAM_INLINE VLong bits_as<VLong>(const VDouble& from) {
    return {(Long4)from.half[0], (Long4)from.half[1]};
}
template <>
MARRAM_INLINE VDouble bits_as<VDouble>(const VLong& from) {
    return {(Double4)from.half[0], (Double4)from.half[1]};
}

// Loads and stores of eight values, aligned or not. By halves: GCC copies a struct 16 bytes at a time, and a
// read of 32 then waits for both writes.
MARRAM_INLINE VDouble vload(const double* p) {
    VDouble v;
    std::memcpy(&v.half[0], p, sizeof v.half[0]);
    std::memcpy(&v.half[1], p + 4, sizeof v.half[1]);
    return v;
}
MARRAM_INLINE void vstore(double* p, const VDouble& v) {
    std::memcpy(p, &v.half[0], sizeof v.half[0]);
    std::memcpy(p + 4, &v.half[1], sizeof v.half[1]);
}
MARRAM_INLINE VFloat vload(const float* p) {
    VFloat v;
    std::memcpy(&v, p, sizeof v);
    return v;
}
MARRAM_INLINE void vstore(float* p, VFloat v) { std::memcpy(p, &v, sizeof v); }

// All eight at once: GCC 12 converts a vector of four two by two.
template <typename V>
MARRAM_INLINE VDouble widened(V x) {
    using Double8 = double __attribute__((vector_size(64), aligned(64)));
    const Double8 w = __builtin_convertvector(x, Double8);
    return {__builtin_shufflevector(w, w, 0, 1, 2, 3), __builtin_shufflevector(w, w, 4, 5, 6, 7)};
}
MARRAM_INLINE VDouble to_double(VFloat x) { return widened(x); }
MARRAM_INLINE VDouble to_double(VInt x) { return widened(x); }
MARRAM_INLINE VFloat to_float(const VDouble& x) {
    using Float4 = float __attribute__((vector_size(16)));
    const Float4 low = __builtin_convertvector(x.half[0], Float4),
                 high = __builtin_convertvector(x.half[1], Float4);
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
}
MARRAM_INLINE VInt low_32_bits(const VLong& x) {
    const VInt pairs = __builtin_shufflevector((VInt)x.half[0], (VInt)x.half[1], 0, 2, 8, 10, 4, 6, 12,
                                               14); // within 16 bytes
    return (VInt)__builtin_shufflevector((Long4)pairs, (Long4)pairs, 0, 2, 1, 3);
}

template <typename T>
using WideVector = std::vector<T, tbb::cache_aligned_allocator<T>>;

MARRAM_INLINE VDouble vsqrt(const VDouble& x) {
    VDouble r;
    for (int i = 0; i < 4; ++i) r.half[0][i] = std::sqrt(x.half[0][i]);
    for (int i = 0; i < 4; ++i) r.half[1][i] = std::sqrt(x.half[1][i]);
    return r;
}
MARRAM_INLINE VFloat vsqrt(VFloat x) {
    VFloat r;
    for (int i = 0; i < lanes; ++i) r[i] = std::sqrt(x[i]);
    return r;
}
MARRAM_INLINE VDouble vabs(const VDouble& x) { return bits_as<VDouble>(bits_as<VLong>(x) & INT64_MAX); }
// The second argument where either is NaN.
MARRAM_INLINE VDouble vmin(const VDouble& a, const VDouble& b) { return select(a < b, a, b); }
MARRAM_INLINE VDouble vmax(const VDouble& a, const VDouble& b) { return select(a > b, a, b); }
MARRAM_INLINE VDouble vmin(const VDouble& a, double b) { return vmin(a, splat(b)); }
MARRAM_INLINE VDouble vmax(const VDouble& a, double b) { return vmax(a, splat(b)); }
MARRAM_INLINE VFloat vmin(VFloat a, VFloat b) { return a < b ? a : b; }
MARRAM_INLINE VFloat vmax(VFloat a, VFloat b) { return a > b ? a : b; }
MARRAM_INLINE bool any(const VLong& mask) {
    const Long4 either = mask.half[0] | mask.half[1];
    return (either[0] | either[1] | either[2] | either[3]) != 0;
}

// Adding this number rounds a double below 2^51 to the nearest integer and leaves that integer in the low
// bits.
inline constexpr double round_magic = 6755399441055744.0;       // 1.5 * 2^52
inline constexpr int64_t round_magic_bits = 0x4338000000000000; // the bits of that number

// The nearest integer, ties to even, |x| < 2^51. V: VDouble, Double4 or double.
template <typename V>
MARRAM_INLINE V vround(V x) {
    return (x + round_magic) - round_magic;
}
MARRAM_INLINE VDouble vfloor(const VDouble& x) {
    const VDouble r = vround(x);
    return r - bits_as<VDouble>((r > x) & bits_as<VLong>(splat(1.0)));
}

// floor(x) and its low 32 bits, |x| < 2^51.
MARRAM_INLINE VDouble vfloor(VDouble x, VInt& cell) {
    const VDouble shifted = x + round_magic;
    VDouble r = shifted - round_magic;
    const VLong above = r > x; // -1 where x was rounded up
    r -= bits_as<VDouble>(above & bits_as<VLong>(splat(1.0)));
    cell = low_32_bits(bits_as<VLong>(shifted) + above);
    return r;
}

// sin and cos of x in [-pi/2, pi/2]: Taylor, error < 1e-13.
MARRAM_INLINE void sincos_half_pi(VDouble x, VDouble& sine, VDouble& cosine) {
    const VDouble z = x * x, z2 = z * z,
                  z4 = z2 * z2; // in pairs: the chain of dependent operations is half as long
    const VDouble s0 = -1.0 / 6.0 + z * (1.0 / 120.0), s1 = -1.0 / 5040.0 + z * (1.0 / 362880.0);
    const VDouble s2 = -1.0 / 39916800.0 + z * (1.0 / 6227020800.0);
    const VDouble s3 = -1.0 / 1307674368000.0 + z * (1.0 / 355687428096000.0); // 1/15!, 1/17!
    sine = x + x * z * ((s0 + z2 * s1) + z4 * (s2 + z2 * s3));
    const VDouble c0 = -0.5 + z * (1.0 / 24.0), c1 = -1.0 / 720.0 + z * (1.0 / 40320.0);
    const VDouble c2 = -1.0 / 3628800.0 + z * (1.0 / 479001600.0);
    const VDouble c3 =
        -1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0 - z * (1.0 / 6402373705728000.0)); // 1/18!
    cosine = 1.0 + z * ((c0 + z2 * c1) + z4 * (c2 + z2 * c3));
}

// sin and cos of any angle below 2^40 radians: reduced to half turns. Error < 1e-13 + 1e-16 |x|.
MARRAM_INLINE void sincos(VDouble x, VDouble& sine, VDouble& cosine) {
    const VDouble shifted = x * (1.0 / 3.14159265358979323846) + round_magic;
    const VLong odd = bits_as<VLong>(shifted) & 1;
    const VDouble n = shifted - round_magic; // half turns
    // pi in three parts, the first two with trailing zeros, so that n * part is exact for n < 2^20
    const VDouble r = ((x - n * 3.141592651605606) - n * 1.9841871583270443e-09) - n * 1.034036596358821e-18;
    sincos_half_pi(r, sine, cosine);
    const VLong flip = odd << 63;
    sine = bits_as<VDouble>(bits_as<VLong>(sine) ^ flip);
    cosine = bits_as<VDouble>(bits_as<VLong>(cosine) ^ flip);
}

// The angle in [0, pi] between (c, s) and the x axis, s >= 0, not both 0. Three halvings of
// the tangent bring it below tan(pi/16); error < 1e-13 rad at every angle, near 0 and pi too.
MARRAM_INLINE VDouble angle_of(VDouble s, VDouble c) {
    const VDouble a = vabs(c);
    VDouble t = s / (vsqrt(s * s + a * a) + a); // tan of half the acute angle
    t = t / (1.0 + vsqrt(1.0 + t * t));
    t = t / (1.0 + vsqrt(1.0 + t * t));
    const VDouble z = t * t, z2 = z * z, z4 = z2 * z2;
    const VDouble p0 = 1.0 / 3.0 - z * (1.0 / 5.0), p1 = 1.0 / 7.0 - z * (1.0 / 9.0);
    const VDouble p2 = 1.0 / 11.0 - z * (1.0 / 13.0), p3 = 1.0 / 15.0 - z * (1.0 / 17.0);
    const VDouble acute = 8.0 * (t - t * z * ((p0 + z2 * p1) + z4 * (p2 + z2 * p3)));
    return select(c < 0.0, 3.14159265358979323846 - acute, acute);
}

// Natural logarithm of a normal x > 0: exponent and mantissa in [sqrt(1/2), sqrt 2), then the series of
// atanh. Error < 1e-15 relative to max(|log x|, 1).
MARRAM_INLINE VDouble vlog(VDouble x) {
    const VLong bits = bits_as<VLong>(x) - 0x3fe6a09e667f3bcdLL; // minus sqrt(1/2)
    const VLong exponent = bits >> 52;
    const VDouble m = bits_as<VDouble>(bits_as<VLong>(x) - (exponent << 52));
    const VDouble e = bits_as<VDouble>(exponent + round_magic_bits) - round_magic;
    const VDouble z = (m - 1.0) / (m + 1.0);
    const VDouble w = z * z;
    VDouble p = splat(1.0 / 19.0);
    p = p * w + 1.0 / 17.0;
    p = p * w + 1.0 / 15.0;
    p = p * w + 1.0 / 13.0;
    p = p * w + 1.0 / 11.0;
    p = p * w + 1.0 / 9.0;
    p = p * w + 1.0 / 7.0;
    p = p * w + 1.0 / 5.0;
    p = p * w + 1.0 / 3.0;
    return e * 0.69314718055994530942 + (2.0 * z + 2.0 * z * w * p);
}

// e^x for x in [-700, 700]. Error < 1e-14 relative.
MARRAM_INLINE VDouble vexp(VDouble x) {
    const VDouble shifted = x * 1.4426950408889634074 + round_magic;
    const VDouble k = shifted - round_magic;
    const VDouble r = (x - k * 0.693145751953125) - k * 1.42860682030941723212e-6; // ln 2 in two parts
    VDouble p = splat(1.0 / 479001600.0);
    p = p * r + 1.0 / 39916800.0;
    p = p * r + 1.0 / 3628800.0;
    p = p * r + 1.0 / 362880.0;
    p = p * r + 1.0 / 40320.0;
    p = p * r + 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = p * r + 1.0;
    p = p * r + 1.0;
    const VLong scale = (bits_as<VLong>(shifted) - round_magic_bits + 1023) << 52;
    return p * bits_as<VDouble>(scale);
}

// Eight rows of eight: row i, column j to row j, column i.
MARRAM_INLINE void transpose(VFloat* rows) {
    VFloat pairs[lanes], fours[lanes];
    for (int k = 0; k < lanes; k += 2) {
        pairs[k] = __builtin_shufflevector(rows[k], rows[k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        pairs[k + 1] = __builtin_shufflevector(rows[k], rows[k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int k = 0; k < lanes; k += 4)
        for (int n = 0; n < 2; ++n) {
            const VFloat a = pairs[k + n], b = pairs[k + 2 + n];
            fours[k + 2 * n] = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
            fours[k + 2 * n + 1] = __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int k = 0; k < 4; ++k) {
        rows[k] = __builtin_shufflevector(fours[k], fours[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        rows[k + 4] = __builtin_shufflevector(fours[k], fours[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

// Three coordinates of eight strands.
template <typename V>
struct alignas(sizeof(V)) Wide3 {
    V x, y, z;
};
using Wide3d = Wide3<VDouble>;
using Wide3f = Wide3<VFloat>;

template <typename V>
MARRAM_INLINE Wide3<V> operator+(const Wide3<V>& a, const Wide3<V>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename V>
MARRAM_INLINE Wide3<V> operator-(const Wide3<V>& a, const Wide3<V>& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename V>
MARRAM_INLINE Wide3<V> operator*(const Wide3<V>& a, const V& s) {
    return {a.x * s, a.y * s, a.z * s};
}
template <typename V>
MARRAM_INLINE V dot(const Wide3<V>& a, const Wide3<V>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename V>
MARRAM_INLINE Wide3<V> cross(const Wide3<V>& a, const Wide3<V>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
MARRAM_INLINE Wide3d select(VLong mask, const Wide3d& a, const Wide3d& b) {
    return {select(mask, a.x, b.x), select(mask, a.y, b.y), select(mask, a.z, b.z)};
}
MARRAM_INLINE Wide3d splat3(const double* v) { return {splat(v[0]), splat(v[1]), splat(v[2])}; }
MARRAM_INLINE Wide3d to_double(const Wide3f& a) { return {to_double(a.x), to_double(a.y), to_double(a.z)}; }
MARRAM_INLINE Wide3f to_float(const Wide3d& a) { return {to_float(a.x), to_float(a.y), to_float(a.z)}; }

MARRAM_INLINE VUint mix32(VUint h) { // core/math/hash.h, eight at once
    h ^= h >> 16;
    h *= 0x7feb352dU;
    h ^= h >> 15;
    h *= 0x846ca68bU;
    return h ^ (h >> 16);
}

} // namespace marram
