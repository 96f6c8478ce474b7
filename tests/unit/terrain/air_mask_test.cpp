// SPDX-License-Identifier: Apache-2.0
// The mask "air" of a terrain: crests in the wind, lees in the calm, as strands feel them.
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdio>
#include <string>

namespace marram::testing {
namespace {

// A dune across x: windward side to -x, slip face of 33 degrees to +x, its crest at x = 0. The mask is 0 at a
// speed of -1, 1 at 2.
std::string blown_dune(const std::string& cell, const std::string& layers,
                       const std::string& wind = "[1, 0, 0]") {
    return "\n[[curves]]\nname = \"crest\"\ntype = \"points\"\npoints = [[0, 0, 60], [0, 0, -60]]\n"
           "[[procedural]]\ntype = \"terrain\"\nname = \"dune\"\nwind.direction = " +
           wind + "\nwind.speed = 6\nsize = [100, 40]\ncell = " + cell +
           "\n[[procedural.layer]]\ntype = \"dune\"\nalong = \"crest\"\nmax_height = 3\nslope_width = 15\n"
           "inner_slope_angle = 33\n[[procedural.layer]]\ntype = \"mask\"\nname = \"air\"\nby = \"air\"\n"
           "ramp = [[-1, 0], [2, 1]]\n" +
           layers;
}

struct Air {
    World world;
    const std::vector<float>& values() const {
        return find_attribute(world.meshes.at(0).attributes, "air")->values;
    }
    // Mean speed over the middle rows between two x.
    double mean(double low, double high) const {
        double sum = 0.0;
        size_t count = 0;
        for (size_t v = 0; v < values().size(); ++v) {
            const Vec3f& p = world.meshes[0].positions[0][v];
            if (double(p.x()) < low || double(p.x()) > high || std::abs(double(p.z())) > 8.0) continue;
            sum += 3.0 * double(values()[v]) - 1.0;
            ++count;
        }
        return sum / double(count);
    }
};

Air air_of(const std::string& text) {
    TestScene scene(text);
    return {scene.build()};
}

TEST(AirMask, IsFastOnCrestsAndReturnsInLees) {
    const Air fine = air_of(blown_dune("0.25", "")), coarse = air_of(blown_dune("0.5", ""));
    std::printf("speed far before a dune %.2f, before it %.2f, on its crest %.2f, in its lee %.2f\n",
                fine.mean(-48, -35), fine.mean(-17, -15), fine.mean(-2, -0.5), fine.mean(2, 4));
    EXPECT_NEAR(fine.mean(-48, -35), 1.0, 0.1);
    EXPECT_LT(fine.mean(-17, -15), 0.95);
    EXPECT_GT(fine.mean(-2, -0.5), 1.25);
    EXPECT_LT(fine.mean(2, 4), 0.2);
    const Air ground = air_of(blown_dune("0.25", "above = 0\n"));
    EXPECT_NEAR(ground.mean(2, 4), -0.15, 1e-6);
    EXPECT_NEAR(ground.mean(-2, -0.5), fine.mean(-2, -0.5), 1e-6); // the same at all heights
    for (const double x : {-40.0, -15.0, -2.0, 2.0, 20.0})
        EXPECT_NEAR(fine.mean(x, x + 1.5), coarse.mean(x, x + 1.5), 0.15) << x;
}

TEST(AirMask, ComesFromWhereTheWindDoes) {
    const Air back = air_of(blown_dune("0.25", "", "[-1, 0, 0]"));
    EXPECT_GT(back.mean(2, 4), 0.3); // its steep side is no lee then
    const Air along = air_of(blown_dune("0.25", "", "[0, 0, 1]"));
    EXPECT_GT(along.mean(2, 4), 0.8);
    const Air flat =
        air_of("\n[[procedural]]\ntype = \"terrain\"\nname = \"plain\"\nsize = [20, 20]\ncell = 0.5\n"
               "[[procedural.layer]]\ntype = \"mask\"\nname = \"air\"\nby = \"air\"\n");
    for (const float value : flat.values()) EXPECT_EQ(value, 1.0F);
}

// More than 2^20 samples are averaged, to much the same air.
TEST(AirMask, LargeTerrainsAreAveraged) {
    const Air fine = air_of(blown_dune("0.05", "")), coarse = air_of(blown_dune("0.25", ""));
    ASSERT_GT(fine.values().size(), size_t(1) << 20);
    for (const double x : {-40.0, -15.0, -2.0, 2.0, 20.0})
        EXPECT_NEAR(fine.mean(x, x + 1.5), coarse.mean(x, x + 1.5), 0.15) << x;
}

TEST(AirMask, AnEditMakesItAnew) {
    TestScene scene(blown_dune("0.5", ""));
    scene.build();
    for (const std::string& other :
         {blown_dune("0.5", "", "[0, 0, 1]"),
          blown_dune(
              "0.5",
              "[[procedural.layer]]\ntype = \"mask\"\nname = \"calm\"\nby = \"mask\"\nof = \"air\"\n")}) {
        scene.update(other);
        const Air updated{scene.build()};
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        EXPECT_EQ(updated.values(), air_of(other).values());
    }
}

// Samples on the border are inside, however their places are rounded.
TEST(AirMask, ReachesToTheBorder) {
    const std::string small = "size = [10.1, 10.1]\ncell = 0.1";
    std::string text = blown_dune("0.25", "", "[-1, 0, 0]");
    text.replace(text.find("size = [100, 40]\ncell = 0.25"), 28, small);
    const Air air = air_of(text);
    const auto n = size_t(std::lround(std::sqrt(double(air.values().size()))));
    ASSERT_EQ(n * n, air.values().size());
    for (size_t k = 0; k < n; ++k) {
        EXPECT_NEAR(air.values()[k * n + n - 1], air.values()[k * n + n - 2], 0.05F) << k;
        EXPECT_NEAR(air.values()[(n - 1) * n + k], air.values()[(n - 2) * n + k], 0.05F) << k;
    }
}

TEST(AirMask, NeedsOneDirectionAlongTheGround) {
    try {
        air_of(blown_dune("0.5", "", "[0, -1, 0]"));
        FAIL();
    } catch (const InputError& error) {
        EXPECT_NE(to_string(error.problems[0]).find("one direction along the ground"), std::string::npos);
    }
}

} // namespace
} // namespace marram::testing
