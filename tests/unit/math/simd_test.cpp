// SPDX-License-Identifier: Apache-2.0
// The polynomials of core/math/simd.h against the C library, which errs by less than an ulp, over their whole
// stated domains.
#include "core/math/simd.h"

#include "core/math/hash.h"
#include "core/math/ramp.h"
#include "procedural/abi/ramp_table.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

using namespace marram;

namespace {

constexpr int points = 1'000'000;

// Greatest error of f(lanes of x) over random x in [low, high], measured by `error(x, result)`.
template <typename Function, typename Error>
double worst(double low, double high, Function&& function, Error&& error) {
    double greatest = 0.0;
    for (int i = 0; i < points; i += lanes) {
        VDouble x;
        for (int lane = 0; lane < lanes; ++lane)
            x[lane] = low + (high - low) * unit_double(hash(17, uint64_t(i + lane)));
        const VDouble result = function(x);
        for (int lane = 0; lane < lanes; ++lane) greatest = std::max(greatest, error(x[lane], result[lane]));
    }
    return greatest;
}

} // namespace

TEST(Simd, SineAndCosine) {
    for (const double range : {0.5 * 3.14159265358979, 100.0, 1e6, 1.0995e12}) { // to 2^40
        const auto sine = [](VDouble x) {
            VDouble s, c;
            sincos(x, s, c);
            return s;
        };
        const auto cosine = [](VDouble x) {
            VDouble s, c;
            sincos(x, s, c);
            return c;
        };
        const double bound = 1e-13 + 1e-16 * range;
        EXPECT_LT(worst(-range, range, sine, [](double x, double r) { return std::abs(r - std::sin(x)); }),
                  bound);
        EXPECT_LT(worst(-range, range, cosine, [](double x, double r) { return std::abs(r - std::cos(x)); }),
                  bound);
    }
}

TEST(Simd, AngleAtEveryAngle) {
    double greatest = 0.0;
    for (int i = 0; i <= 200'000; ++i) {
        // Dense towards both ends, where acos would lose half its digits.
        const double t = double(i) / 200'000, end = std::pow(10.0, -14.0 * (1.0 - t));
        for (const double angle : {end, 3.14159265358979 * t, 3.14159265358979 - end}) {
            const VDouble r = angle_of(splat(std::sin(angle) * 1e-20), splat(std::cos(angle) * 1e-20));
            greatest = std::max(greatest, std::abs(r[0] - std::atan2(std::sin(angle), std::cos(angle))));
        }
    }
    EXPECT_LT(greatest, 1e-13);
    EXPECT_EQ(angle_of(splat(0.0), splat(1.0))[0], 0.0);
}

TEST(Simd, LogarithmAndExponential) {
    const auto log_error = [](double x, double r) {
        return std::abs(r - std::log(x)) / std::max(1.0, std::abs(std::log(x)));
    };
    EXPECT_LT(worst(
                  1e-12, 4.0, [](VDouble x) { return vlog(x); }, log_error),
              1e-15);
    // The exponents of all normal numbers.
    double greatest = 0.0;
    for (int i = 0; i < points; ++i) {
        const double x =
            std::ldexp(1.0 + unit_double(hash(18, uint64_t(i))), int(hash(19, uint64_t(i)) % 2046) - 1022);
        greatest = std::max(greatest, log_error(x, vlog(splat(x))[0]));
    }
    EXPECT_LT(greatest, 1e-15);
    EXPECT_LT(worst(
                  -700.0, 700.0, [](VDouble x) { return vexp(x); },
                  [](double x, double r) { return std::abs(r / std::exp(x) - 1.0); }),
              1e-14);
    EXPECT_EQ(vlog(splat(1.0))[0], 0.0);
    EXPECT_EQ(vexp(splat(0.0))[0], 1.0);
}

// Every pair of these: signed zeros, neighbours of 1, denormal and infinite numbers, NaN.
TEST(Simd, ComparisonsAndSelectionsAreThoseOfScalars) {
    const double special[] = {0.0,
                              -0.0,
                              1.0,
                              std::nextafter(1.0, 2.0),
                              -1.0,
                              5e-324,
                              -5e-324,
                              1e300,
                              std::numeric_limits<double>::infinity(),
                              -std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::quiet_NaN()};
    const auto same_bits = [](double a, double b) {
        return std::bit_cast<uint64_t>(a) == std::bit_cast<uint64_t>(b);
    };
    for (const double a : special)
        for (const double b : special)
            for (int lane = 0; lane < lanes; ++lane) {
                // The pair in one lane, another pair in the others.
                VDouble va = splat(0.5), vb = splat(0.25);
                va[lane] = a, vb[lane] = b;
                EXPECT_EQ((va < vb)[lane], a < b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ((va <= vb)[lane], a <= b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ((va > vb)[lane], a > b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ((va >= vb)[lane], a >= b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ((va == vb)[lane], a == b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ((va != vb)[lane], a != b ? -1 : 0) << a << ' ' << b;
                EXPECT_EQ(any(va < vb), a < b) << a << ' ' << b;
                for (int other = 0; other < lanes; ++other)
                    EXPECT_TRUE(same_bits(select(va < vb, va, vb)[other],
                                          va[other] < vb[other] ? va[other] : vb[other]));
                EXPECT_TRUE(same_bits(vmin(va, vb)[lane], a < b ? a : b)) << a << ' ' << b;
                EXPECT_TRUE(same_bits(vmax(va, vb)[lane], a > b ? a : b)) << a << ' ' << b;
                const float fa = float(a), fb = float(b);
                const auto float_bits = [](float x) { return std::bit_cast<uint32_t>(x); };
                EXPECT_EQ(float_bits(vmin(splat_float(fa), splat_float(fb))[lane]),
                          float_bits(fa < fb ? fa : fb));
                EXPECT_TRUE(same_bits(vabs(va)[lane], std::abs(a)));
            }
}

TEST(Simd, LoadsStoresAndConversionsKeepEachLane) {
    alignas(64) double values[24];
    float floats[24];
    for (int i = 0; i < 24; ++i) values[i] = 1.0 / (i + 3) - 0.1, floats[i] = float(values[i]);
    for (int first = 0; first <= 16; ++first) { // aligned or not
        const VDouble v = vload(values + first);
        const VFloat f = vload(floats + first);
        double back[lanes];
        float float_back[lanes];
        vstore(back, v), vstore(float_back, f);
        for (int lane = 0; lane < lanes; ++lane) {
            EXPECT_EQ(v[lane], values[first + lane]);
            EXPECT_EQ(back[lane], values[first + lane]);
            EXPECT_EQ(float_back[lane], floats[first + lane]);
            EXPECT_EQ(to_double(f)[lane], double(floats[first + lane]));
            EXPECT_EQ(to_float(v)[lane], float(values[first + lane]));
        }
    }
    VLong wide;
    for (int lane = 0; lane < lanes; ++lane) wide[lane] = int64_t(hash(3, uint64_t(lane)));
    for (int lane = 0; lane < lanes; ++lane)
        EXPECT_EQ(low_32_bits(wide)[lane], int32_t(uint32_t(uint64_t(wide[lane]))));
}

namespace {

// Everything in simd.h that rounds, one after the other.
MARRAM_INLINE void use_everything(const double* in, double* out) {
    const VDouble x = vload(in), y = vload(in + lanes);
    VDouble sine, cosine;
    sincos(x, sine, cosine);
    VInt cell;
    const VDouble floor = vfloor(y * 100.0, cell);
    const VDouble angle = angle_of(vabs(sine) + 1e-9, cosine);
    const VDouble rest = vlog(vabs(y) + 1e-3) + vexp(vmin(sine * 3.0, 2.0)) / (1.0 + x * x);
    const VFloat single = vsqrt(to_float(vabs(x))) * 0.3F + vmax(to_float(y), splat_float(-0.5F));
    const VDouble noise = to_double((VInt)(mix32((VUint)cell) >> 8));
    vstore(out, sine + floor * cosine);
    vstore(out + lanes, select(angle > 1.0, angle - rest, rest * angle));
    vstore(out + 2 * lanes, to_double(single) + vround(noise * 1e-3) + vsqrt(noise));
}
void use_everything_on_baseline(const double* in, double* out) { use_everything(in, out); }
#if defined(__x86_64__) && !defined(__clang__)
__attribute__((target("arch=x86-64-v3"))) void use_everything_on_avx2(const double* in, double* out) {
    use_everything(in, out);
}
#endif

} // namespace

TEST(Simd, InstructionSetsAgree) {
#if defined(__x86_64__) && !defined(__clang__)
    if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "needs a processor with AVX2";
    for (int i = 0; i < 100'000; ++i) {
        double in[2 * lanes], baseline[3 * lanes], avx2[3 * lanes];
        for (int k = 0; k < 2 * lanes; ++k)
            in[k] = 200.0 * unit_double(hash(5, uint64_t(i * 2 * lanes + k))) - 100.0;
        use_everything_on_baseline(in, baseline);
        use_everything_on_avx2(in, avx2);
        ASSERT_EQ(std::memcmp(baseline, avx2, sizeof avx2), 0) << i;
    }
#else
    GTEST_SKIP() << "one instruction set alone";
#endif
}

TEST(Simd, FloorAndCell) {
    for (const double x : {0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.5, 3.5, -2.5, 1e6 + 0.25, -1e6 - 0.25,
                           4294967296.0, 1e15 + 0.5}) {
        VInt cell;
        EXPECT_EQ(vfloor(splat(x), cell)[0], std::floor(x)) << x;
        EXPECT_EQ(cell[0], int32_t(uint32_t(int64_t(std::floor(x))))) << x;
    }
}

TEST(Simd, RowsBecomeColumns) {
    VFloat rows[lanes];
    for (int i = 0; i < lanes; ++i)
        for (int j = 0; j < lanes; ++j) rows[i][j] = float(10 * i + j);
    transpose(rows);
    for (int i = 0; i < lanes; ++i)
        for (int j = 0; j < lanes; ++j) EXPECT_EQ(rows[i][j], float(10 * j + i)) << i << " " << j;
}

TEST(Simd, RampsAgreeWithTheScalarOnes) {
    const std::vector<double> knots = {-1.0, 0.3, 0.25, 1.0, 0.25001, 0.2, 3.0, 0.7};
    for (const char* interpolation : {"linear", "smooth", "constant"}) {
        const Ramp ramp(knots, interpolation);
        for (double x = -2.0; x < 4.0; x += 0.0137)
            EXPECT_NEAR(evaluate(ramp, splat(x))[3], ramp(x), 1e-12) << interpolation << x;
        for (size_t i = 0; i < knots.size(); i += 2)
            EXPECT_EQ(evaluate(ramp, splat(knots[i]))[0], ramp(knots[i]));
    }
}
