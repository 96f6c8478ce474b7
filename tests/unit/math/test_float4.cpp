// SPDX-License-Identifier: Apache-2.0
#include "core/math/float4.h"
#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <limits>

using namespace marram;

// The whole domain, in every lane.
TEST(Float4, ExponentialOfNegative) {
    double worst = 0.0;
    for (uint64_t i = 0; i < 250000; ++i) {
        Float4 x{};
        for (int lane = 0; lane < 4; ++lane)
            x[lane] = -87.0F * unit_float(mix32(uint32_t(4 * i) + uint32_t(lane)));
        if (i % 2 == 0) x *= 0.01F;
        const Float4 e = exp_of_negative(x);
        for (int lane = 0; lane < 4; ++lane) {
            const double exact = std::exp(double(x[lane]));
            worst = std::max(worst, std::abs(double(e[lane]) - exact) / exact);
        }
    }
    std::printf("relative error of exp_of_negative: %.2g\n", worst);
    EXPECT_LT(worst, 2e-7);
    const float far = -std::numeric_limits<float>::infinity();
    const Float4 ends = exp_of_negative(Float4{0.0F, -0.0F, -87.1F, far});
    EXPECT_EQ(ends[0], 1.0F);
    EXPECT_EQ(ends[1], 1.0F);
    EXPECT_EQ(ends[2], 0.0F);
    EXPECT_EQ(ends[3], 0.0F);
}

// All angles, a wide range of lengths, and the axes.
TEST(Float4, ArcTangent) {
    double worst = 0.0;
    for (uint32_t i = 0; i < 1000000; ++i) {
        const double angle = 2.0 * 3.14159265358979 * (unit_float(mix32(2 * i)) - 0.5);
        const double length = std::exp(80.0 * (unit_float(mix32(2 * i + 1)) - 0.5));
        const auto x = float(length * std::cos(angle)), y = float(length * std::sin(angle));
        worst = std::max(worst, std::abs(double(fast_atan2(y, x)) - std::atan2(double(y), double(x))));
    }
    std::printf("error of fast_atan2: %.2g radians\n", worst);
    EXPECT_LT(worst, 4e-7);
    for (const float x : {-1.0F, 0.0F, 1e-38F, 1.0F})
        for (const float y : {-1.0F, 0.0F, 1e-38F, 1.0F})
            EXPECT_NEAR(fast_atan2(y, x), std::atan2(y, x), 3e-7F) << y << " " << x;
    const Float4 lanes = fast_atan2(Float4{1.0F, -1.0F, 1.0F, -1.0F}, Float4{1.0F, 1.0F, -1.0F, -1.0F});
    for (int lane = 0; lane < 4; ++lane)
        EXPECT_NEAR(lanes[lane], (lane % 2 == 0 ? 0.785398163F : -0.785398163F) * (lane < 2 ? 1.0F : 3.0F),
                    3e-7F);
}

// Different values in each lane, in all quadrants and at their boundaries.
TEST(Float4, SineAndCosine) {
    double worst = 0.0;
    for (uint32_t i = 0; i < 1000000; ++i) {
        Float4 x{};
        for (uint32_t lane = 0; lane < 4; ++lane)
            x[lane] = (i % 2 == 0 ? 14.0F : 200.0F) * (unit_float(mix32(4 * i + lane)) - 0.5F);
        if (i % 10 == 0) x = round(x) * 1.57079633F; // multiples of pi / 2, at most 100
        x = min(max(x, Float4{} - 100.0F), Float4{} + 100.0F);
        Float4 sine, cosine;
        fast_sin_cos(x, sine, cosine);
        for (int lane = 0; lane < 4; ++lane) {
            worst = std::max(worst, std::abs(double(sine[lane]) - std::sin(double(x[lane]))));
            worst = std::max(worst, std::abs(double(cosine[lane]) - std::cos(double(x[lane]))));
        }
    }
    std::printf("error of fast_sin_cos: %.2g\n", worst);
    EXPECT_LT(worst, 2e-7);
    Float4 sine, cosine;
    fast_sin_cos(Float4{}, sine, cosine);
    EXPECT_EQ(sine[0], 0.0F);
    EXPECT_EQ(cosine[0], 1.0F);
}

TEST(Float4, RoundsToTheNearest) {
    const Float4 a = round(Float4{-2.5F, 0.49F, 1.5F, -0.0F}),
                 b = round(Float4{4194303.25F, -4194303.75F, 2.5F, 0.51F});
    EXPECT_EQ(a[0], -2.0F);
    EXPECT_EQ(a[1], 0.0F);
    EXPECT_EQ(a[2], 2.0F);
    EXPECT_EQ(a[3], 0.0F);
    EXPECT_EQ(b[0], 4194303.0F);
    EXPECT_EQ(b[1], -4194304.0F);
    EXPECT_EQ(b[2], 2.0F);
    EXPECT_EQ(b[3], 1.0F);
}
