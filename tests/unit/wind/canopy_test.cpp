// SPDX-License-Identifier: Apache-2.0
// The wind in a stand of plants against its definition: inside, at its edge, behind a gap.
#include "procedural/wind/canopy.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

namespace marram::testing::canopy {
namespace {

constexpr double stem_height = 0.7, stem_area = 0.01; // m, m^2

// 400 stems on each square metre where `bears`, evenly: a plant area index of 4.
std::vector<CanopyStrand> stand_where(const std::function<bool(double, double)>& bears) {
    std::vector<CanopyStrand> strands;
    for (int j = 0; j < 800; ++j)
        for (int i = 0; i < 800; ++i) {
            const double x = (i - 399.5) * 0.05, z = (j - 399.5) * 0.05;
            if (bears(x, z)) strands.push_back({x, z, stem_height, stem_area});
        }
    return strands;
}

TEST(Canopy, HasTheAttenuationOfItsPlants) {
    const Canopy canopy(stand_where([](double, double) { return true; }), {});
    const Canopy::Stand middle = canopy.at(15.0, 0.0, Vec3d::UnitX());
    std::printf("index %.3f, height %.3f m, air slows over %.2f m, attenuation inside %.3f\n",
                canopy.mean_index(), canopy.mean_height(), canopy.adjustment(), middle.attenuation);
    EXPECT_NEAR(canopy.mean_index(), 4.0, 0.1);
    EXPECT_NEAR(canopy.mean_height(), stem_height, 1e-9);
    EXPECT_NEAR(middle.height, stem_height, 1e-6);
    EXPECT_NEAR(middle.attenuation, 0.2 * 4.0 / (2.0 * 0.09), 0.1); // 4.4, Speck's 4.4 +- 0.5
    // Denser plants are bounded; the artist's number is that far inside.
    std::vector<CanopyStrand> dense = stand_where([](double, double) { return true; });
    for (CanopyStrand& strand : dense) strand.area *= 5.0;
    EXPECT_EQ(Canopy(dense, {}).at(15.0, 0.0, Vec3d::UnitX()).attenuation, Canopy::most_attenuation);
    EXPECT_NEAR(Canopy(dense, 2.5).at(15.0, 0.0, Vec3d::UnitX()).attenuation, 2.5, 0.05);
}

// The upwind mean over a stand that begins at x = 0 is P (1 - exp(-x / l)), but for the cells at its edge.
TEST(Canopy, FeelsMoreWindAtItsEdge) {
    const Canopy canopy(stand_where([](double x, double) { return x > 0.0; }), {});
    const double inside = 0.2 * 4.0 / (2.0 * 0.09);
    double worst = 0.0, before = -1.0;
    for (double x = 0.1; x < 18.0; x += 0.1) {
        const double a = canopy.at(x, 0.0, Vec3d::UnitX()).attenuation;
        EXPECT_GE(a, before - 0.02) << x;
        if (before >= 0.0) { // no terraces
            EXPECT_LT(a - before, 0.05 * inside) << x;
        }
        before = a;
        worst = std::max(worst, std::abs(a - inside * (1.0 - std::exp(-x / canopy.adjustment()))));
    }
    std::printf("behind an edge: attenuation off by up to %.2f of %.2f\n", worst, inside);
    EXPECT_LT(worst, 0.06 * inside);
    // Wind out of the stand has gone through all of it; across the edge half of the points are in it.
    EXPECT_GT(canopy.at(0.5, 0.0, -Vec3d::UnitX()).attenuation, 0.85 * inside);
    // Behind a gap of four times its length the air has recovered to a large part.
    const Canopy gapped(stand_where([](double x, double) { return x < 0.0 || x > 10.0; }), {});
    EXPECT_LT(gapped.at(10.3, 0.0, Vec3d::UnitX()).attenuation, 0.3 * inside);
    EXPECT_LT(canopy.at(-50.0, 0.0, Vec3d::UnitX()).attenuation, 1e-12); // open ground
}

TEST(Canopy, IsTheProfileAtEachCv) {
    const Canopy canopy(stand_where([](double, double) { return true; }), {});
    Strands strands;
    strands.resize(11, 5, false);
    const Vec3d normal = Vec3d(0.2, 1.0, -0.1).normalized();
    for (int i = 0; i < strands.blocks * lanes; ++i) {
        const Vec3d root(0.3 * i, 0.1 * i, -0.2 * i);
        set_lane(strands.root_normal[size_t(i / lanes)], i % lanes, normal);
        for (int k = 0; k < 5; ++k)
            set_lane(strands.rest[size_t(i / lanes) * 5 + size_t(k)], i % lanes,
                     root + (0.22 + 0.01 * i) * k * normal);
    }
    canopy.attenuate(Vec3d::UnitX(), strands);
    double worst = 0.0;
    for (int i = 0; i < strands.count; ++i)
        for (int k = 0; k < 5; ++k) {
            const Canopy::Stand stand =
                canopy.at(double(float(0.3 * i)), double(float(-0.2 * i)), Vec3d::UnitX());
            const double z = (0.22 + 0.01 * i) * k;
            const double share = std::exp(-stand.attenuation * (1.0 - std::min(z / stand.height, 1.0)));
            worst = std::max(
                worst,
                std::abs(double(strands.canopy[size_t(i / lanes) * 5 + size_t(k)][i % lanes]) - share));
        }
    std::printf("share of the wind's speed off by %.2g\n", worst);
    EXPECT_LT(worst, 2e-6);
}

TEST(Canopy, OfNothingIsStill) {
    EXPECT_EQ(Canopy({}, {}).at(0.0, 0.0, Vec3d::UnitX()).attenuation, 0.0);
    EXPECT_EQ(Canopy({{1.0, 2.0, 0.0, 0.0}}, {}).at(1.0, 2.0, Vec3d::UnitX()).attenuation, 0.0); // no height
    const Canopy one({{1.0, 2.0, 0.5, 0.01}}, {});
    EXPECT_TRUE(std::isfinite(one.at(1.0, 2.0, Vec3d::UnitY()).attenuation)); // a vertical wind
    EXPECT_LT(one.at(1.0, 2.0, Vec3d::UnitX()).attenuation, 0.1);
}

} // namespace
} // namespace marram::testing::canopy
