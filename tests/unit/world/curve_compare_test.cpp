// SPDX-License-Identifier: Apache-2.0
#include "core/world/curve_compare.h"

#include <gtest/gtest.h>

#include <cmath>

namespace marram {
namespace {

// Straight strands along x, a metre apart along z, with a height for each motion sample.
struct Strands {
    std::vector<std::vector<float>> samples;
    World world;

    Strands(uint64_t count, uint32_t cvs, const std::vector<double>& heights, double length) {
        for (const double height : heights) {
            std::vector<float>& all = samples.emplace_back();
            for (uint64_t c = 0; c < count; ++c)
                for (uint32_t k = 0; k < cvs + 2; ++k) {
                    const double u = (double(k) - 1.0) / (cvs - 1);
                    for (const double x : {length * u, height, double(c), 0.01}) all.push_back(float(x));
                }
        }
        CurveGeometry curves;
        curves.curve_count = count;
        curves.cvs_per_curve = cvs;
        for (const auto& sample : samples) curves.vertices.push_back(sample.data());
        world.curves.push_back(curves);
    }
};

TEST(CurveCompare, PosesAreComparedByTheStrandsLength) {
    const Strands a(100, 5, {0.25}, 2.0), b(100, 5, {0.0}, 2.0), fine(100, 33, {0.0}, 2.0);
    const CurveDistance gap = relative_cv_distance(a.world, b.world);
    EXPECT_NEAR(gap.rms, 0.125, 1e-12);
    EXPECT_NEAR(gap.worst, 0.125, 1e-12);
    EXPECT_EQ(gap.strands, 100U);
    EXPECT_NEAR(relative_cv_distance(a.world, fine.world).worst, 0.125, 1e-7);
    EXPECT_NEAR(relative_cv_distance(b.world, fine.world).worst, 0.0, 1e-7);
    EXPECT_EQ(relative_cv_distance(b.world, b.world).rms, 0.0);
}

TEST(CurveCompare, MotionIsComparedAtEveryTimeOfTheReference) {
    // A parabola with samples only at its ends, and with one in the middle.
    const Strands two(10, 4, {0.0, 1.0}, 1.0), three(10, 4, {0.0, 0.25, 1.0}, 1.0);
    EXPECT_NEAR(motion_cv_distance(two.world, three.world).worst, 0.25, 1e-7);
    EXPECT_NEAR(motion_cv_distance(two.world, three.world).rms, 0.25, 1e-7);
    EXPECT_EQ(motion_cv_distance(three.world, two.world).worst, 0.0) << "it is there at both ends";
    const Strands still(10, 4, {0.5}, 1.0);
    EXPECT_NEAR(motion_cv_distance(still.world, two.world).worst, 0.5, 1e-7);
}

TEST(CurveCompare, NinetyNineInAHundredStayBelow) {
    Strands a(1000, 4, {0.0}, 1.0);
    const Strands b(1000, 4, {0.0}, 1.0);
    for (size_t c = 0; c < 20; ++c) // one strand in fifty, by c + 1 metres
        for (size_t k = 0; k < 6; ++k) a.samples[0][(c * 6 + k) * 4 + 1] = float(c + 1);
    const CurveDistance gap = motion_cv_distance(a.world, b.world, {}, 15.0);
    EXPECT_EQ(gap.worst, 20.0);
    EXPECT_EQ(gap.beyond, 0.005);
    EXPECT_EQ(gap.most, 10.0);
    EXPECT_NEAR(gap.rms, std::sqrt(2870.0 / 1000.0), 1e-6);
    EXPECT_EQ(motion_cv_distance(World{}, World{}).strands, 0U);
    const Strands c(2, 4, {0.0}, 1.0);
    Strands d(2, 4, {0.0}, 1.0);
    for (size_t k = 0; k < 6; ++k) d.samples[0][k * 4 + 1] = 3.0F;
    EXPECT_EQ(motion_cv_distance(d.world, c.world).most, 3.0) << "of two the worst";
}

TEST(CurveCompare, OtherStrandsAreRefused) {
    const Strands a(10, 4, {0.0}, 1.0), b(11, 4, {0.0}, 1.0);
    EXPECT_THROW(relative_cv_distance(a.world, b.world), std::invalid_argument);
    EXPECT_THROW(relative_cv_distance(a.world, World{}), std::invalid_argument);
}

} // namespace
} // namespace marram
