// SPDX-License-Identifier: Apache-2.0
#include "core/math/float4.h"
#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <limits>

using namespace marram;

// Over all of its domain, in every lane.
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
