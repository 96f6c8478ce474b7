// SPDX-License-Identifier: Apache-2.0
// Winds that differ from place to place: what is drawn, and the sand that follows it.
#include "procedural/terrain/solver/solver.h"
#include "procedural/terrain/wind_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <string>
#include <utility>

namespace marram {
namespace {

std::string fault_of(const auto& make) {
    try {
        make();
    } catch (const SceneFault& fault) {
        return fault.what();
    }
    return "";
}

TEST(WindField, FollowsCurvesAndTurnsByHalfAtTheirReach) {
    const Domain domain{201, 101, 1.0, -100.0, -50.0};
    const double angle = 20.0 * degree;
    DrawnCurve line;
    for (int k = -5000; k <= 5000; k += 100) // crosses the middle
        line.points.push_back({k * std::cos(angle), 0.0, k * std::sin(angle)});
    const WindField field = wind_field_along({line}, 30.0, domain, Vec2d::UnitX(), "scene.toml:1:1");
    const auto turn = [&](double x, double z) {
        return double(field.turn[domain.index(int(x + 100.0), int(z + 50.0))]) / degree;
    };
    EXPECT_NEAR(turn(0.0, 0.0), 20.0 * 30.0 / 31.0, 0.05); // a cell is 1 m
    for (const double across :
         {-40.0, -10.0, 20.0, 30.0}) { // metres from the curve, along z: times its cosine
        const double d = std::abs(across) * std::cos(angle);
        EXPECT_NEAR(turn(0.0, across), 20.0 * 30.0 / (30.0 + d), 0.3) << across;
    }
    for (const float strength : field.strength) EXPECT_EQ(strength, 1.0F);
    // The same from the other side: the wind blows to -x, the curve is drawn the other way.
    std::reverse(line.points.begin(), line.points.end());
    const WindField other = wind_field_along({line}, 30.0, domain, -Vec2d::UnitX(), "");
    for (size_t k = 0; k < field.turn.size(); ++k) EXPECT_NEAR(field.turn[k], other.turn[k], 1e-5);
}

TEST(WindField, SaysWhereItTurnsTooFar) {
    const Domain domain{21, 21, 1.0, 0.0, 0.0};
    const DrawnCurve steep{{{0.0, 0.0, 0.0}, {10.0, 0.0, 10.0}, {20.0, 0.0, 20.0}}, false};
    EXPECT_NE(fault_of([&] {
                  wind_field_along({steep}, 100.0, domain, Vec2d::UnitX(), "");
              }).find("turns the wind by 4"),
              std::string::npos);
    const DrawnCurve point{{{1.0, 0.0, 1.0}, {1.0, 3.0, 1.0}}, true};
    EXPECT_NE(fault_of([&] { wind_field_along({point}, 100.0, domain, Vec2d::UnitX(), ""); }), "");
    MarramGrid grid{};
    grid.nx = 2, grid.ny = 1, grid.nz = 1, grid.components = 2;
    std::array<float, 4> values = {1.0F, 0.0F, 2.0F, 1.0F};
    grid.values = values.data();
    const WindField field = wind_field_of_image(grid, domain, "");
    EXPECT_NEAR(field.strength[20], std::hypot(2.0, 1.0), 1e-6);
    EXPECT_NEAR(field.turn[20], std::atan2(1.0, 2.0), 1e-6);
    EXPECT_EQ(field.turn[0], 0.0F);
    for (const float bad : {std::nanf(""), 11.0F, -1.0F}) { // not finite; too strong; turned by 180 degrees
        values[0] = bad;
        EXPECT_NE(fault_of([&] { wind_field_of_image(grid, domain, ""); }), "") << bad;
    }
    grid.components = 1;
    EXPECT_NE(fault_of([&] { wind_field_of_image(grid, domain, ""); }), "");
}

struct FieldScene {
    Domain domain{96, 96, 2.0, 0.0, 0.0};
    std::vector<float> rock = std::vector<float>(domain.count(), 0.0F);
    std::vector<SandUnits> sand = std::vector<SandUnits>(domain.count(), 0);
    WindField field;

    FieldScene() {
        field.turn.assign(domain.count(), 0.0F);
        field.strength.assign(domain.count(), 1.0F);
    }
    void heap(double x, double z, double height) {
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i) {
                const double r = std::hypot(domain.x(i) - x, domain.z(j) - z);
                sand[domain.index(i, j)] += sand_units(height * std::exp(-r * r / 150.0));
            }
    }
    std::vector<SandUnits> blown(const SandWind& wind, double hours,
                                 DuneBorder border = DuneBorder::periodic) {
        DuneSolverSettings settings;
        settings.border = border;
        EXPECT_EQ(DuneSolver::problem(domain, settings, rock.data(), sand.data(), field), "");
        DuneSolver solver(domain, settings, rock.data(), sand.data(), nullptr, field);
        solver.advance(steady_wind(wind), hours * seconds_per_hour);
        std::vector<SandUnits> out(sand.size());
        solver.sand(out);
        EXPECT_EQ(std::accumulate(out.begin(), out.end(), SandUnits(0)) + solver.airborne() + solver.out() -
                      solver.in(),
                  std::accumulate(sand.begin(), sand.end(), SandUnits(0)));
        return out;
    }
    // The centre of the sand in rows [j0, j1).
    Vec2d centre(const std::vector<SandUnits>& of, int j0, int j1) const {
        Vec2d sum = Vec2d::Zero();
        double all = 0.0;
        for (int j = j0; j < j1; ++j)
            for (int i = 0; i < domain.nx; ++i) {
                const double metres = sand_metres(of[domain.index(i, j)]);
                sum += metres * Vec2d(domain.x(i), domain.z(j)), all += metres;
            }
        return sum / all;
    }
};

// A field that turns the wind everywhere is a wind of that direction.
TEST(WindField, AUniformTurnIsATurnedWind) {
    for (const double from : {0.0, 40.0, 100.0, 200.0, 290.0}) {
        FieldScene scene;
        scene.heap(96.0, 96.0, 3.0);
        const double heading = from * degree, turned = heading + 25.0 * degree;
        FieldScene plain = scene;
        plain.field = {};
        std::fill(scene.field.turn.begin(), scene.field.turn.end(), float(25.0 * degree));
        std::fill(scene.field.strength.begin(), scene.field.strength.end(), 1.25F);
        const std::vector<SandUnits> a = scene.blown({std::cos(heading), std::sin(heading), 0.4}, 60.0),
                                     b = plain.blown({std::cos(turned), std::sin(turned), 0.5}, 60.0);
        double worst = 0.0;
        for (size_t k = 0; k < a.size(); ++k)
            worst = std::max(worst, std::abs(sand_metres(a[k]) - sand_metres(b[k])));
        std::printf("wind towards %3.0f degrees: %.2g m\n", from, worst);
        // The march may cross rows along the other axis.
        EXPECT_LT(worst, 0.12) << from;
    }
}

// Two heaps, each in its own wind, 20 degrees to either side.
TEST(WindField, EachHeapGoesWithItsOwnWind) {
    FieldScene scene;
    scene.heap(60.0, 48.0, 3.0), scene.heap(60.0, 144.0, 3.0);
    for (int j = 0; j < 96; ++j)
        for (int i = 0; i < 96; ++i) {
            const double t = std::clamp((scene.domain.z(j) - 80.0) / 30.0, 0.0, 1.0);
            scene.field.turn[scene.domain.index(i, j)] = float((40.0 * t - 20.0) * degree);
        }
    for (const bool along_x : {true, false}) {
        FieldScene turned = scene;
        if (!along_x)
            for (int j = 0; j < 96; ++j) // mirrored at the diagonal: turns have the other sign
                for (int i = 0; i < 96; ++i) {
                    turned.sand[scene.domain.index(j, i)] = scene.sand[scene.domain.index(i, j)];
                    turned.field.turn[scene.domain.index(j, i)] = -scene.field.turn[scene.domain.index(i, j)];
                }
        std::vector<SandUnits> after = turned.blown(
            along_x ? SandWind{1.0, 0.0, 0.45} : SandWind{0.0, 1.0, 0.45}, 150.0, DuneBorder::open);
        if (!along_x) {
            std::vector<SandUnits> back(after.size());
            for (int j = 0; j < 96; ++j)
                for (int i = 0; i < 96; ++i) back[scene.domain.index(i, j)] = after[scene.domain.index(j, i)];
            after = back;
        }
        for (const int half : {0, 1}) {
            const Vec2d moved = scene.centre(after, 48 * half, 48 * half + 48) -
                                scene.centre(scene.sand, 48 * half, 48 * half + 48);
            const double angle = std::atan2(moved.y(), moved.x()) / degree;
            std::printf("half %d: %.2f m at %.1f degrees\n", half, moved.norm(), angle);
            EXPECT_GT(moved.norm(), 2.0);
            EXPECT_NEAR(angle, half == 0 ? -20.0 : 20.0, 3.0);
        }
    }
}

// Level sand stays level at a periodic border when the wind changes, whatever the field's strength.
TEST(WindField, AChangeOfTheWindLeavesLevelSand) {
    for (const float strength : {1.5F, 3.0F}) {
        FieldScene scene;
        std::fill(scene.sand.begin(), scene.sand.end(), sand_units(5.0));
        std::fill(scene.field.strength.begin(), scene.field.strength.end(), strength);
        DuneSolver solver(scene.domain, {}, scene.rock.data(), scene.sand.data(), nullptr, scene.field);
        for (const double u : {0.2205, 0.4, 0.2205, 0.1, 0.3}) solver.step({1.0, 0.2, u}, 3600.0);
        std::vector<SandUnits> sand(scene.sand.size());
        solver.sand(sand);
        for (const SandUnits units : sand) ASSERT_NEAR(sand_metres(units), 5.0, 1e-3) << strength;
    }
}

// Plants that grow, with wakes, in a field: sand is conserved to the unit on grids of any size.
TEST(WindField, SandIsConservedAmongGrowingPlants) {
    for (const auto& [nx, nz] : {std::pair(17, 9), std::pair(5, 60), std::pair(33, 80)}) {
        FieldScene scene;
        scene.domain = {nx, nz, 1.0, 0.0, 0.0};
        const size_t count = scene.domain.count();
        scene.rock.assign(count, 0.0F), scene.sand.assign(count, 0);
        std::vector<float> plants(count);
        scene.field.turn.assign(count, 0.0F), scene.field.strength.assign(count, 1.0F);
        for (size_t k = 0; k < count; ++k) {
            scene.sand[k] = sand_units(1.0 + 0.8 * std::sin(0.7 * double(k)));
            scene.field.turn[k] = float(25.0 * degree * std::sin(0.05 * double(k)));
            plants[k] = k % 5 == 0 ? 1.0F : 0.0F;
        }
        DuneSolverSettings settings;
        settings.border = DuneBorder::open, settings.influx = 0.5;
        settings.growth = {2.0 / seconds_per_year, 0.5, 0.3, 0.5, 2.1};
        DuneSolver solver(scene.domain, settings, scene.rock.data(), scene.sand.data(), plants.data(),
                          scene.field);
        for (int k = 0; k < 40; ++k) solver.step({0.8, k % 2 == 0 ? 0.6 : -0.6, 0.45}, 1e5);
        std::vector<SandUnits> sand(count);
        solver.sand(sand);
        EXPECT_EQ(std::accumulate(sand.begin(), sand.end(), SandUnits(0)) + solver.out() - solver.in(),
                  std::accumulate(scene.sand.begin(), scene.sand.end(), SandUnits(0)));
        EXPECT_GE(*std::min_element(sand.begin(), sand.end()), 0);
        std::vector<float> cover(count);
        solver.cover(cover);
        for (const float share : cover) ASSERT_TRUE(share >= 0.0F && share <= 1.0F);
    }
}

TEST(WindField, WhereItIsCalmSandStays) {
    FieldScene scene;
    scene.heap(60.0, 48.0, 2.0), scene.heap(60.0, 144.0, 2.0);
    for (int j = 0; j < 48; ++j)
        for (int i = 0; i < 96; ++i) scene.field.strength[scene.domain.index(i, j)] = 0.2F;
    const std::vector<SandUnits> after = scene.blown({1.0, 0.1, 0.45}, 20.0);
    for (size_t k = 4 * 96; k < 44 * 96; ++k)
        EXPECT_LE(std::abs(sand_metres(after[k] - scene.sand[k])), 1e-3) << k;
    EXPECT_NE(after, scene.sand); // some leaves the windy half and settles at once
}

} // namespace
} // namespace marram
