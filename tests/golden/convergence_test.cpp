// SPDX-License-Identifier: Apache-2.0
// Noise against samples, on scenes of the golden frames. The squared difference of two renders with different
// seeds has twice the variance of one, so no reference is needed: pixels are unbiased, and variance is their
// whole error. With independent samples variance falls with power -1 of their number, and its root with -1/2.
// The sampler's stratification does better where pixels are smooth in many dimensions, at best -3/2 for the
// root.
#include "tests/golden/goldens.h"
#include "tests/whole.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

namespace marram::golden {
namespace {

constexpr std::array<uint32_t, 3> counts = {2, 8, 32};

// Root of the pixels' mean variance, relative to the picture's mean.
double noise_of(const Stage& stage, uint32_t samples) {
    const Picture a = stage.render(101, samples), b = stage.render(202, samples);
    const std::vector<float>&x = a.layers[0].pixels, &y = b.layers[0].pixels;
    double level = 0.0, sum = 0.0;
    for (size_t i = 0; i < x.size(); ++i) {
        const double difference = double(x[i]) - double(y[i]);
        level += 0.5 * (double(x[i]) + double(y[i])) / double(x.size());
        sum += 0.5 * difference * difference / double(x.size());
    }
    return std::sqrt(sum) / level;
}

void expect_convergence(const Golden& golden) {
    const Stage stage(golden);
    double noise[counts.size()], mean_x = 0.0, mean_y = 0.0, xx = 0.0, xy = 0.0;
    for (size_t i = 0; i < counts.size(); ++i) {
        noise[i] = noise_of(stage, counts[i]);
        mean_x += std::log2(double(counts[i])) / double(counts.size());
        mean_y += std::log2(noise[i]) / double(counts.size());
    }
    for (size_t i = 0; i < counts.size(); ++i) {
        const double x = std::log2(double(counts[i])) - mean_x;
        xx += x * x;
        xy += x * (std::log2(noise[i]) - mean_y);
    }
    const double power = xy / xx;
    std::printf("noise of %-12s %.4f %.4f %.4f with 2, 8, 32 samples: power %.2f, half of it costs %.1f "
                "times the samples\n",
                golden.name.c_str(), noise[0], noise[1], noise[2], power, std::exp2(-1.0 / power));
    EXPECT_LT(power, -0.45) << golden.name;
    EXPECT_GT(power, -1.5) << golden.name;
}

class Convergence : public ::testing::TestWithParam<const char*> {};

TEST_P(Convergence, FallsWithTheRootOfTheSamplesOrFaster) { expect_convergence(golden_named(GetParam())); }

// A scene for each kind of light and material.
INSTANTIATE_TEST_SUITE_P(Of, Convergence, ::testing::Values("room", "sun", "lamp", "still", "hair"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Convergence, HoldsInTheGallery) {
    size_t index = 0;
    for (const Golden& golden : goldens())
        if (golden.scene.find("golden/") == std::string::npos && testing::in_this_run(index++, 4))
            expect_convergence(golden);
    EXPECT_GT(index, 20U);
}

} // namespace
} // namespace marram::golden
