// SPDX-License-Identifier: Apache-2.0
// The fusion layer against its page: sand exact, slopes bounded on both diagonals, the same bits at any thread count.
#include "procedural/terrain/fusion.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>
#include <vector>

namespace marram {
namespace {

struct FusionScene {
    Domain domain;
    std::vector<float> rock;
    std::vector<SandUnits> sand;

    explicit FusionScene(int nx, int nz, double cell = 1.0)
        : domain{nx, nz, cell, 0.0, 0.0}, rock(domain.count(), 0.0F), sand(domain.count(), 0) {}
    template <typename F>
    void pile(F&& height) { // of metres from the middle
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i) {
                const double x = (i - domain.nx / 2) * domain.cell, z = (j - domain.nz / 2) * domain.cell;
                sand[domain.index(i, j)] = sand_units(std::max(0.0, double(height(x, z))));
            }
    }
    double height(int i, int j) const {
        return double(rock[domain.index(i, j)]) + sand_metres(sand[domain.index(i, j)]);
    }
};

// The steepest triangle of three sandy corners, degrees: written out on its own, corner by corner.
double fusion_steepest_degrees(const FusionScene& scene) {
    const Domain& d = scene.domain;
    double steepest = 0.0;
    for (int j = 0; j + 1 < d.nz; ++j)
        for (int i = 0; i + 1 < d.nx; ++i)
            for (int corner = 0; corner < 4; ++corner) {
                const int px = i + (corner & 1), pz = j + (corner >> 1);
                const int qx = 2 * i + 1 - px, rz = 2 * j + 1 - pz;
                if (scene.sand[d.index(px, pz)] <= 0 || scene.sand[d.index(qx, pz)] <= 0 ||
                    scene.sand[d.index(px, rz)] <= 0)
                    continue;
                const double h = scene.height(px, pz);
                steepest = std::max(steepest, std::hypot(scene.height(qx, pz) - h, scene.height(px, rz) - h));
            }
    return std::atan(steepest / d.cell) / degree;
}

FusionResult fusion_expect_relaxed(FusionScene& scene, FusionSettings settings = {}) {
    const std::vector<SandUnits> before = scene.sand;
    const FusionResult result = relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), settings, {});
    SandUnits lost = 0, least = 0;
    for (size_t k = 0; k < before.size(); ++k) {
        lost += before[k] - scene.sand[k];
        least = std::min(least, scene.sand[k]);
    }
    EXPECT_EQ(lost, 0);
    EXPECT_EQ(least, 0);
    EXPECT_TRUE(result.settled);
    EXPECT_FALSE(result.cancelled);
    const double steepest = fusion_steepest_degrees(scene);
    EXPECT_LE(steepest, settings.repose / degree + 0.5);
    EXPECT_NEAR(steepest, result.steepest / degree, 1e-3);
    return result;
}

TEST(Fusion, ConesAndRidgesInAnyDirectionComeToRest) {
    for (const double angle : {0.0, std::atan(0.4), 45.0 * degree, 88.0 * degree}) {
        FusionScene ridge(160, 144);
        const double c = std::cos(angle), s = std::sin(angle);
        ridge.pile([&](double x, double z) {
            return std::min(12.0 - 1.5 * std::abs(x * c + z * s), 30.0 - std::abs(z * c - x * s));
        });
        EXPECT_GT(fusion_expect_relaxed(ridge).moved, 10.0);
    }
    for (const double repose : {5.0, 20.0, 34.0, 60.0}) {
        FusionScene cone(128, 128);
        cone.pile([](double x, double z) { return 20.0 * (1.0 - std::hypot(x, z) / 10.0); });
        fusion_expect_relaxed(cone, {.repose = repose * degree});
    }
}

TEST(Fusion, ARelaxedConeIsRound) {
    FusionScene cone(192, 192);
    cone.pile([](double x, double z) { return (40.0 - std::hypot(x, z)) * std::tan(50.0 * degree); });
    fusion_expect_relaxed(cone);
    std::vector<double> radii;
    for (int n = 0; n < 8; ++n) { // where half of the height is reached
        const double half = 0.5 * cone.height(96, 96);
        const double c = std::cos(n * pi / 4), s = std::sin(n * pi / 4);
        const auto at = [&](double distance) {
            const double x = 96 + distance * c, z = 96 + distance * s;
            const int i = int(x), j = int(z);
            const double u = x - i, v = z - j;
            return (1 - u) * (1 - v) * cone.height(i, j) + u * (1 - v) * cone.height(i + 1, j) +
                   (1 - u) * v * cone.height(i, j + 1) + u * v * cone.height(i + 1, j + 1);
        };
        double r = 0.0;
        while (at(r) > half) r += 0.01;
        radii.push_back(r);
        EXPECT_NEAR(std::atan((at(r - 10) - at(r + 10)) / 20.0) / degree, 34.0, 1.0) << n;
    }
    const auto [least, most] = std::minmax_element(radii.begin(), radii.end());
    std::printf("radii at half height: %.3f to %.3f\n", *least, *most);
    EXPECT_LT(*most / *least, 1.05); // along diagonals triangles are steeper than the cone by 1 / (4 r)
    for (size_t n = 0; n < 4; ++n) EXPECT_NEAR(radii[n] / radii[n + 4], 1.0, 0.01) << n; // no drift
    for (size_t n = 0; n < 6; ++n) EXPECT_NEAR(radii[n] / radii[n + 2], 1.0, 0.02) << n; // x as z
}

TEST(Fusion, RandomHeapsOnRandomRock) {
    for (uint64_t seed = 1; seed <= 3; ++seed) {
        FusionScene scene(150, 131);
        for (size_t k = 0; k < scene.rock.size(); ++k) {
            scene.rock[k] = float(6.0 * unit_double(hash(seed, k / 7)));
            scene.sand[k] = sand_units(std::max(0.0, 9.0 * unit_double(hash(seed + 9, k)) - 5.0));
        }
        const std::vector<float> rock = scene.rock;
        fusion_expect_relaxed(scene);
        EXPECT_EQ(rock, scene.rock);
    }
}

TEST(Fusion, ACliffOfSandCollapses) {
    FusionScene cliff(200, 40);
    cliff.pile([](double x, double) { return x < 0.0 ? 30.0 : 0.0; });
    fusion_expect_relaxed(cliff);
    EXPECT_LT(cliff.height(99, 20), 16.5); // a wedge about where the cliff stood
    EXPECT_GT(cliff.height(99, 20), 13.5);
}

TEST(Fusion, SandSlidesOffSteepRock) {
    for (const int turn : {0, 1, 2}) {
        FusionScene ramp(96, 96);
        for (int j = 0; j < 96; ++j)
            for (int i = 0; i < 96; ++i) {
                const double up = turn == 0 ? i : turn == 1 ? 95 - j : (i + j) * std::sqrt(0.5);
                ramp.rock[ramp.domain.index(i, j)] = float(std::max(0.0, up - 30.0) * std::tan(60 * degree));
                ramp.sand[ramp.domain.index(i, j)] = sand_units(0.2);
            }
        fusion_expect_relaxed(ramp);
        EXPECT_EQ(ramp.sand[ramp.domain.index(90, turn == 1 ? 5 : 90)], 0);
        EXPECT_GT(ramp.sand[ramp.domain.index(turn == 1 ? 48 : 30, turn == 1   ? 65
                                                                   : turn == 2 ? 12
                                                                               : 48)],
                  sand_units(0.2));
    }
}

TEST(Fusion, StableSandStaysToTheBit) {
    FusionScene scene(130, 70);
    scene.pile(
        [](double x, double z) { // a cone with a round top: that of a sharp one is steeper than its flank
            return (25.0 - std::sqrt(x * x + z * z + 25.0)) * std::tan(33.5 * degree);
        });
    const auto before = scene.sand;
    EXPECT_EQ(fusion_expect_relaxed(scene).sweeps, 0);
    EXPECT_EQ(before, scene.sand);
    FusionScene bare(70, 70); // nothing to move on the steepest rock
    for (size_t k = 0; k < bare.rock.size(); ++k) bare.rock[k] = float(unit_double(hash(1, k)) * 1e5);
    EXPECT_EQ(fusion_expect_relaxed(bare).moved, 0.0);
}

TEST(Fusion, SandInAHollowOfASteepFaceStays) {
    FusionScene stairs(96, 64); // treads of 8 samples that lean back, risers: mean slope 45 degrees
    for (int j = 0; j < 64; ++j)
        for (int i = 0; i < 96; ++i) {
            const bool lip = i % 8 == 0;
            stairs.rock[stairs.domain.index(i, j)] = float(8 * (i / 8) + (lip ? 1.0 : 0.0));
            stairs.sand[stairs.domain.index(i, j)] = lip ? 0 : sand_units(0.9);
        }
    const auto before = stairs.sand;
    stairs.sand[stairs.domain.index(91, 60)] += sand_units(3.0); // wakes the corner
    fusion_expect_relaxed(stairs);
    for (int i = 0; i < 80; ++i)
        EXPECT_EQ(before[stairs.domain.index(i, 20)], stairs.sand[stairs.domain.index(i, 20)]) << i;
}

TEST(Fusion, TheSameBitsAtAnyThreadCount) {
    std::vector<SandUnits> results[2];
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        FusionScene scene(260, 200);
        for (size_t k = 0; k < scene.rock.size(); ++k) scene.rock[k] = float(unit_double(hash(4, k / 11)));
        scene.pile([](double x, double z) { return 14.0 - 1.6 * std::hypot(x * 0.2, z) + std::sin(x); });
        relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, {});
        results[threads - 1] = scene.sand;
    }
    EXPECT_EQ(results[0], results[1]);
}

TEST(Fusion, SmallDomainsAndExtremeCells) {
    for (const auto& [nx, nz] : {std::pair{1, 1}, {1, 40}, {40, 1}, {2, 2}, {17, 3}, {65, 66}}) {
        FusionScene scene(nx, nz);
        scene.pile([](double x, double z) { return 9.0 - std::abs(x) - std::abs(z); });
        scene.sand[0] += sand_units(50.0);
        fusion_expect_relaxed(scene);
    }
    for (const double cell : {0.001, 100.0})
        for (const double base : {0.0, 1e5}) {
            FusionScene scene(64, 64, cell);
            std::fill(scene.rock.begin(), scene.rock.end(), float(base));
            scene.pile([&](double x, double z) { return 2.0 * (15.0 * cell - std::hypot(x, z)); });
            EXPECT_GT(fusion_expect_relaxed(scene).moved, 0.0);
        }
}

TEST(Fusion, OutOfRangeAndCancelledLeaveTheSand) {
    FusionScene scene(32, 32);
    scene.pile([](double x, double) { return 9.0 - 3.0 * std::abs(x); });
    const auto before = scene.sand;
    EXPECT_TRUE(
        relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, [] { return true; }).cancelled);
    EXPECT_EQ(before, scene.sand);
    scene.rock[5] = std::numeric_limits<float>::max();
    EXPECT_FALSE(relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, {}).settled);
    EXPECT_EQ(before, scene.sand);
}

} // namespace
} // namespace marram
