// SPDX-License-Identifier: Apache-2.0
// The polynomials of core/math/simd.h against the C library, which errs by less than an ulp, over their whole stated domains.
#include "core/math/simd.h"

#include "core/math/hash.h"
#include "core/math/ramp.h"
#include "procedural/ramp_table.h"

#include <gtest/gtest.h>

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

TEST(Simd, sine_and_cosine) {
    for (const double range : {0.5 * 3.14159265358979, 100.0, 1e6}) {
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

TEST(Simd, angle_at_every_angle) {
    double greatest = 0.0;
    for (int i = 0; i <= 200'000; ++i) {
        // Dense towards both ends, where acos would lose half its digits.
        const double t = double(i) / 200'000, end = std::pow(10.0, -14.0 * (1.0 - t));
        for (const double angle : {end, 3.14159265358979 * t, 3.14159265358979 - end}) {
            const VDouble r = angle_of(splat(std::sin(angle) * 1e-20), splat(std::cos(angle) * 1e-20));
            greatest = std::max(greatest, std::abs(r[0] - std::atan2(std::sin(angle), std::cos(angle))));
        }
    }
    EXPECT_LT(greatest, 1e-12);
    EXPECT_EQ(angle_of(splat(0.0), splat(1.0))[0], 0.0);
}

TEST(Simd, logarithm_and_exponential) {
    EXPECT_LT(worst(
                  1e-12, 4.0, [](VDouble x) { return vlog(x); },
                  [](double x, double r) {
                      return std::abs(r - std::log(x)) / std::max(1.0, std::abs(std::log(x)));
                  }),
              1e-14);
    EXPECT_LT(worst(
                  -600.0, 600.0, [](VDouble x) { return vexp(x); },
                  [](double x, double r) { return std::abs(r / std::exp(x) - 1.0); }),
              1e-13);
    EXPECT_EQ(vlog(splat(1.0))[0], 0.0);
    EXPECT_EQ(vexp(splat(0.0))[0], 1.0);
}

TEST(Simd, floor_and_cell) {
    for (const double x : {0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.5, 3.5, -2.5, 1e6 + 0.25, -1e6 - 0.25,
                           4294967296.0, 1e15 + 0.5}) {
        VInt cell;
        EXPECT_EQ(vfloor(splat(x), cell)[0], std::floor(x)) << x;
        EXPECT_EQ(cell[0], int32_t(uint32_t(int64_t(std::floor(x))))) << x;
    }
}

TEST(Simd, ramps_agree_with_the_scalar_ones) {
    const std::vector<double> knots = {-1.0, 0.3, 0.25, 1.0, 0.25001, 0.2, 3.0, 0.7};
    for (const char* interpolation : {"linear", "smooth", "constant"}) {
        const Ramp ramp(knots, interpolation);
        for (double x = -2.0; x < 4.0; x += 0.0137)
            EXPECT_NEAR(evaluate(ramp, splat(x))[3], ramp(x), 1e-12) << interpolation << x;
        for (size_t i = 0; i < knots.size(); i += 2)
            EXPECT_EQ(evaluate(ramp, splat(knots[i]))[0], ramp(knots[i]));
    }
}
