// SPDX-License-Identifier: Apache-2.0
// Meshes that stand in the dune solver's wind and sand: their height field, and what the solver does around
// them.
#include "procedural/terrain/obstacle.h"

#include "core/math/hash.h"
#include "procedural/terrain/solver/solver.h"
#include "tests/unit/terrain/block_mesh.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <numeric>

namespace marram {
namespace {

// A terrain with its middle at the origin, level sand, and what stands in it.
struct ObstacleField {
    Domain domain;
    std::vector<float> rock;
    std::vector<SandUnits> sand;
    BlockMesh blocks;

    ObstacleField(int nx, int nz, double cell, double thickness)
        : domain{nx, nz, cell, -0.5 * nx * cell, -0.5 * nz * cell}, rock(domain.count(), 0.0F),
          sand(domain.count(), sand_units(thickness)) {}

    Fields below() const { return {rock.data(), sand.data(), {}}; }
    std::vector<Obstacle::Top> tops() const { return Obstacle(domain, blocks.mesh()).tops(below()); }
    // The height of the obstacle at each sample; 0 where nothing stands.
    std::vector<double> heights() const {
        std::vector<double> heights(domain.count(), 0.0);
        for (const Obstacle::Top& top : tops()) heights[top.sample] = double(top.height);
        return heights;
    }
    size_t nearest(double x, double z) const {
        return domain.index(int(std::lround((x - domain.x0) / domain.cell)),
                            int(std::lround((z - domain.z0) / domain.cell)));
    }
    // With the obstacle in place of the sand.
    DuneSolver solver(const DuneSolverSettings& settings) {
        for (const Obstacle::Top& top : tops()) {
            sand[top.sample] = 0;
            rock[top.sample] = std::max(rock[top.sample], top.height);
        }
        EXPECT_EQ(DuneSolver::problem(domain, settings, rock.data(), sand.data()), "");
        return DuneSolver(domain, settings, rock.data(), sand.data());
    }
};

std::vector<SandUnits> obstacle_sand(const DuneSolver& solver, const ObstacleField& field) {
    std::vector<SandUnits> sand(field.domain.count());
    solver.sand(sand);
    return sand;
}

// A wall at nine angles stands in exactly the cells that it crosses, at its height.
TEST(Obstacle, StandsInTheCellsThatItCrosses) {
    for (int turn = 0; turn < 9; ++turn) {
        ObstacleField field(64, 48, 0.5, 0.5);
        field.blocks.turn = turn * 0.19;
        field.blocks.box(-5.03, 6.11, -1.0, 2.7, -0.26, 0.33);
        const std::vector<double> heights = field.heights();
        const double c = std::cos(field.blocks.turn), s = std::sin(field.blocks.turn);
        size_t standing = 0;
        for (int j = 0; j < field.domain.nz; ++j)
            for (int i = 0; i < field.domain.nx; ++i) {
                // Distance of the wall's rectangle from the points of a fine grid in the cell.
                double least = infinity;
                for (int b = 0; b <= 20; ++b)
                    for (int a = 0; a <= 20; ++a) {
                        const double x = field.domain.x(i) + 0.5 * (a / 20.0 - 0.5),
                                     z = field.domain.z(j) + 0.5 * (b / 20.0 - 0.5);
                        const double u = c * x + s * z, v = c * z - s * x;
                        least =
                            std::min(least, std::max(std::abs(u - 0.54) - 5.57, std::abs(v - 0.035) - 0.295));
                    }
                const double height = heights[field.domain.index(i, j)];
                standing += height > 0.0;
                if (least <= -1e-6) {
                    EXPECT_FLOAT_EQ(float(height), 2.7F) << turn << " " << i << " " << j;
                }
                if (least >= 0.0354) { // half the diagonal of the fine grid
                    EXPECT_EQ(height, 0.0) << turn << " " << i << " " << j;
                }
            }
        EXPECT_GT(standing, 30U);
    }
}

// A ring of sheets without thickness separates what is inside from what is outside, also across corners of
// cells.
TEST(Obstacle, ThinSheetsLeaveNoHole) {
    ObstacleField field(80, 80, 0.5, 0.3);
    constexpr int sides = 17;
    for (int k = 0; k < sides; ++k) {
        const double a = 2.0 * pi * k / sides, b = 2.0 * pi * (k + 1) / sides;
        field.blocks.sheet(12.0 * std::cos(a), 12.0 * std::sin(a), 12.0 * std::cos(b), 12.0 * std::sin(b),
                           0.0, 1.5);
    }
    const std::vector<double> heights = field.heights();
    std::vector<char> seen(field.domain.count(), 0);
    std::vector<size_t> open{field.nearest(0.0, 0.0)};
    seen[open[0]] = 1;
    for (size_t n = 0; n < open.size(); ++n) {
        const int i = int(open[n] % 80), j = int(open[n] / 80);
        for (int dj = -1; dj <= 1; ++dj)
            for (int di = -1; di <= 1; ++di) {
                ASSERT_TRUE(i + di >= 0 && i + di < 80 && j + dj >= 0 && j + dj < 80);
                const size_t k = field.domain.index(i + di, j + dj);
                if (!seen[k] && heights[k] == 0.0) seen[k] = 1, open.push_back(k);
            }
    }
    EXPECT_NEAR(double(open.size()) * 0.25, pi * 144.0, 40.0);
}

// Sand and wind pass through a door and under a roof. What lies below the sand keeps it from sinking.
TEST(Obstacle, DoorsAreOpen) {
    ObstacleField field(64, 64, 0.25, 0.5);
    field.blocks.box(-4.0, -1.0, -1.0, 3.0, -0.5, 0.5); // wall
    field.blocks.box(1.0, 4.0, -1.0, 3.0, -0.5, 0.5);
    field.blocks.box(-1.0, 1.0, 2.4, 3.0, -0.5, 0.5);   // lintel
    field.blocks.box(-4.0, 4.0, 3.0, 3.2, 0.5, 5.0);    // roof
    field.blocks.box(-4.0, 4.0, -1.0, 0.2, -5.0, -3.0); // buried
    field.blocks.box(2.0, 3.0, 3.0, 4.5, -0.5, 0.5);    // upon the wall
    const std::vector<double> heights = field.heights();
    EXPECT_EQ(heights[field.nearest(-2.0, 0.0)], 3.0);
    EXPECT_EQ(heights[field.nearest(2.5, 0.0)], 4.5);
    EXPECT_EQ(heights[field.nearest(0.0, 0.0)], 0.0);
    EXPECT_EQ(heights[field.nearest(0.0, 3.0)], 0.0);
    EXPECT_FLOAT_EQ(float(heights[field.nearest(0.0, -4.0)]), 0.2F);
}

// A door as wide as two cells, with jambs on the borders of cells, stays open. The winding of a mesh does not
// matter; without a bottom it is hollow.
TEST(Obstacle, BordersAndWindings) {
    ObstacleField field(32, 32, 0.5, 0.5);
    const double border = 0.25; // of cells: between samples at 0 and 0.5
    field.blocks.box(border - 4.0, border, -1.0, 3.0, border, border + 0.5);
    field.blocks.box(border + 1.0, border + 4.0, -1.0, 3.0, border, border + 0.5);
    EXPECT_EQ(field.heights()[field.nearest(1.0, 0.5)], 0.0);
    EXPECT_EQ(field.heights()[field.nearest(0.0, 0.5)], 3.0);

    for (const bool inverted : {false, true}) {
        ObstacleField solid(32, 32, 0.5, 0.5);
        solid.blocks.box(-3.1, 2.9, -1.0, 2.0, -2.1, 2.2);
        if (inverted)
            for (size_t k = 0; k < solid.blocks.triangles.size(); k += 3)
                std::swap(solid.blocks.triangles[k], solid.blocks.triangles[k + 1]);
        EXPECT_EQ(solid.tops().size(), 13U * 9U);
        EXPECT_EQ(Obstacle(solid.domain, solid.blocks.mesh()).open_samples(), 0U);
        solid.blocks.triangles.erase(solid.blocks.triangles.begin(), solid.blocks.triangles.begin() + 6);
        EXPECT_EQ(Obstacle(solid.domain, solid.blocks.mesh()).open_samples(), 12U * 9U);
        EXPECT_EQ(solid.tops().size(), 2U * 13U + 2U * 7U);
    }
}

TEST(Obstacle, InvalidMeshesAreLeftOut) {
    ObstacleField field(16, 16, 1.0, 0.5);
    EXPECT_TRUE(Obstacle(field.domain, field.blocks.mesh()).empty());
    EXPECT_TRUE(Obstacle(field.domain, MarramMesh{}).empty());
    field.blocks.box(-2.0, 2.0, 0.0, 1.0, -2.0, 2.0);
    const size_t whole = field.tops().size();
    EXPECT_EQ(whole, 25U);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    field.blocks.positions.insert(field.blocks.positions.end(), {nan, 0.0F, 1e30F, 1e30F, 1e30F, -1e30F});
    const auto last = uint32_t(field.blocks.positions.size() / 3);
    for (const uint32_t v : {0U, 1U, last - 2, 0U, 1U, last, 0U, 0U, 0U, 0U, 1U, last - 1})
        field.blocks.triangles.push_back(v);
    for (const Obstacle::Top& top : field.tops()) EXPECT_TRUE(std::isfinite(top.height));
    field.blocks.positions.resize(3 * size_t(last - 2)); // the far vertices are gone
    EXPECT_EQ(field.tops().size(), whole);
    field.blocks.turn = 0.0;
    BlockMesh far;
    far.box(100.0, 101.0, 0.0, 1.0, 0.0, 1.0);
    EXPECT_TRUE(Obstacle(field.domain, far.mesh()).empty());
}

// The level in the mesh is that beside it; the lower one in a wall of one cell; its own where sand buries it,
// but not on top of a wall that shows a face.
TEST(Obstacle, IsFilledToTheLevelBesideIt) {
    const Domain domain{12, 4, 0.5, 0.0, 0.0};
    const std::vector<float> rock(domain.count(), 0.25F);
    std::vector<SandUnits> sand(domain.count(), sand_units(0.0));
    std::vector<Obstacle::Top> tops;
    std::vector<SandUnits> on_top;
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 12; ++i) {
            const size_t k = domain.index(i, j);
            sand[k] = sand_units(i < 3 ? 2.0 : 1.0);
            if (i == 3 || i == 8 || i == 9)
                tops.push_back({k, 3.0F}), on_top.push_back(i == 3 ? 0 : sand_units(0.3));
            if (i == 6) tops.push_back({k, 1.0F}), on_top.push_back(sand_units(0.25));
            if (i > 9) sand[k] = 0;
        }
    fill_obstacle(domain, rock.data(), tops, on_top, sand.data());
    for (int i = 0; i < 12; ++i) {
        const double expected = i < 3 ? 2.0 : i < 9 ? 1.0 : 0.0;
        EXPECT_NEAR(sand_metres(sand[domain.index(i, 1)]), expected, 1e-9) << i;
    }
}

// A mesh that lies a little below the sand of a slope does not show.
TEST(Obstacle, ABuriedMeshLeavesTheSurface) {
    for (const double cover : {0.01, 0.05, 0.3}) {
        ObstacleField field(40, 40, 0.4, 0.0);
        std::vector<Obstacle::Top> tops;
        std::vector<SandUnits> on_top;
        for (int j = 0; j < 40; ++j)
            for (int i = 0; i < 40; ++i) {
                const double height = 10.0 - 0.5 * 0.4 * i;
                const size_t k = field.domain.index(i, j);
                field.sand[k] = sand_units(height);
                if (i >= 16 && i < 24 && j >= 10 && j < 30)
                    tops.push_back({k, float(height - cover)}), on_top.push_back(sand_units(cover));
            }
        std::vector<SandUnits> filled = field.sand;
        fill_obstacle(field.domain, field.rock.data(), tops, on_top, filled.data());
        for (size_t k = 0; k < filled.size(); ++k)
            ASSERT_NEAR(sand_metres(filled[k] - field.sand[k]), 0.0, 1e-3) << cover;
    }
}

// A court behind walls: sand gathers in front and is kept out, the lee is blown bare, and every unit is
// accounted for. Winds along and oblique to the grid; the same bits on one thread.
TEST(Obstacle, WallsKeepSandOut) {
    for (const double turn : {0.0, 0.6}) {
        ObstacleField field(80, 80, 0.6, 0.3);
        field.blocks.turn = turn;
        for (const double side : {-5.0, 5.0}) {
            field.blocks.box(side - 0.6, side + 0.6, -1.0, 2.5, -5.6, 5.6);
            field.blocks.box(-5.6, 5.6, -1.0, 2.5, side - 0.6, side + 0.6);
        }
        DuneSolverSettings settings;
        settings.border = DuneBorder::open;
        settings.influx = 1.0;
        const SandWind wind{std::cos(turn), std::sin(turn), 0.4};
        const auto blown = [&] {
            ObstacleField copy = field;
            DuneSolver solver = copy.solver(settings);
            const SandUnits before = std::accumulate(copy.sand.begin(), copy.sand.end(), SandUnits(0));
            EXPECT_TRUE(solver.advance(steady_wind(wind), 86400.0));
            std::vector<SandUnits> sand = obstacle_sand(solver, copy);
            EXPECT_EQ(std::accumulate(sand.begin(), sand.end(), SandUnits(0)) + solver.out() - solver.in(),
                      before);
            return sand;
        };
        const std::vector<SandUnits> sand = blown();
        {
            const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
            EXPECT_EQ(sand, blown());
        }
        EXPECT_GE(*std::min_element(sand.begin(), sand.end()), 0);
        double court = 0.0, front = 0.0, lee = infinity, max_court = 0.0;
        int count = 0;
        for (int j = 0; j < 80; ++j)
            for (int i = 0; i < 80; ++i) {
                const double x = field.domain.x(i), z = field.domain.z(j);
                const double u = std::cos(turn) * x + std::sin(turn) * z,
                             v = std::cos(turn) * z - std::sin(turn) * x;
                const double depth = sand_metres(sand[field.domain.index(i, j)]);
                if (std::max(std::abs(u), std::abs(v)) < 3.5)
                    court += depth, ++count, max_court = std::max(max_court, depth);
                if (std::abs(v) < 3.0 && u > -18.0 && u < -6.5) front = std::max(front, depth);
                if (std::abs(v) < 3.0 && u > 7.0) lee = std::min(lee, depth);
            }
        std::printf("turn %.1f: court %.4f m (most %.4f), in front %.3f m, least in the lee %.3f m\n", turn,
                    court / count, max_court, front, lee);
        EXPECT_NEAR(court / count, 0.3, 0.003);
        EXPECT_GT(front, 0.4);
        EXPECT_LT(lee, 0.2);
    }
}

// Behind a wall and in front of it the shelter is a triangle, forwards, backwards and oblique to the grid;
// without `convergence` it is as wide as the wall.
TEST(Obstacle, TheShelterOfAWallNarrows) {
    constexpr double cell = 0.5, width = 8.0;
    for (const double drift : {0.0, 0.5, -1.0})
        for (const bool backwards : {false, true})
            for (const bool periodic : {false, true})
                for (const double convergence : {0.0, 0.25}) {
                    const DownwindGrid course = {160, 150, periodic, cell, backwards, drift};
                    const auto pitch = size_t(Shear::pitch(course.columns));
                    WideVector<float> height(pitch * 160 + 16, 0.0F), excess(pitch * 160 + 16, 0.0F);
                    for (const size_t row : {79U, 80U})
                        for (size_t column = 67; column < 83; ++column) height[row * pitch + column] = 3.0F;
                    SeparationSettings settings;
                    settings.convergence = convergence;
                    Separation().find(course, settings, height.data(), 3.0, pitch, excess.data());
                    const auto sheltered =
                        [&](int rows) { // metres across the wind; rows downwind of the wall
                            const int row = rows > 0 ? (backwards ? 79 - rows : 80 + rows)
                                                     : (backwards ? 80 - rows : 79 + rows);
                            int count = 0;
                            for (size_t column = 0; column < 150; ++column)
                                count += excess[size_t(row) * pitch + column] > 0.0F;
                            return count * cell / std::hypot(1.0, drift);
                        };
                    const double whole = width / std::hypot(1.0, drift);
                    for (const int rows : {-12, -8, -4, 4, 8, 16, 28}) {
                        const double along = std::abs(rows) * course.spacing();
                        if (along > (rows > 0 ? 17.0 : 11.0)) continue;
                        const double expected = std::max(whole - 2.0 * convergence * along, 0.0);
                        EXPECT_NEAR(sheltered(rows), expected, 1.6)
                            << drift << backwards << periodic << " " << convergence << " " << rows;
                    }
                }
}

// On periodic ground the shelter is the same wherever the wall stands, also across the seam.
TEST(Obstacle, TheShelterOfAWallCrossesTheSeam) {
    for (const double drift : {0.0, 1.0})
        for (const bool backwards : {false, true}) {
            const DownwindGrid course = {64, 64, true, 0.5, backwards, drift};
            const auto pitch = size_t(Shear::pitch(course.columns));
            const auto found = [&](size_t shift) { // excess, shifted back
                WideVector<float> height(pitch * 64 + 16, 0.0F), excess(pitch * 64 + 16, 0.0F);
                for (const size_t row : {30U, 31U})
                    for (size_t column = 24; column < 40; ++column)
                        height[(row + shift) % 64 * pitch + column] = 3.0F;
                SeparationSettings settings;
                settings.convergence = 0.25;
                Separation().find(course, settings, height.data(), 3.0, pitch, excess.data());
                std::vector<float> list;
                for (size_t row = 0; row < 64; ++row)
                    for (size_t column = 0; column < 64; ++column)
                        list.push_back(excess[(row + shift) % 64 * pitch + column]);
                return list;
            };
            const std::vector<float> middle = found(0);
            EXPECT_GT(*std::max_element(middle.begin(), middle.end()), 1.0F);
            for (const size_t shift : {1U, 20U, 31U, 34U, 50U}) {
                const std::vector<float> shifted = found(shift);
                for (size_t k = 0; k < middle.size(); ++k)
                    ASSERT_NEAR(double(shifted[k]), double(middle[k]), 1e-4)
                        << drift << backwards << " " << shift << " " << k;
            }
        }
}

// A wall beside the wind's way is no slope: the flux along its foot is that of open ground, and turns
// nowhere.
TEST(Obstacle, AWallAlongTheWindIsNoSlope) {
    for (const bool backwards : {false, true}) {
        const DownwindGrid course = {16, 48, true, 0.5, backwards, 0.0};
        const auto pitch = size_t(Shear::pitch(course.columns));
        WideVector<float> height(pitch * 16, 0.4F), none(pitch * 16, 0.0F);
        WideVector<float> flux(pitch * 16), relax(pitch * 16), turn(pitch * 16), reach(pitch * 16);
        for (size_t row = 0; row < 16; ++row)
            for (const size_t column : {20U, 21U}) height[row * pitch + column] = 3.0F;
        AirFields air;
        air.height = height.data();
        air.excess = air.along = air.across = none.data();
        SandPhysics physics;
        physics.steepest = 1.0;
        saturate(course, DuneBorder::periodic, physics, 16.0, backwards ? -1.0 : 1.0, 0.0, 0.4, air, pitch,
                 {flux.data(), relax.data(), turn.data(), reach.data()});
        for (size_t row = 0; row < 16; ++row)
            for (size_t column = 0; column < 48; ++column) {
                EXPECT_NEAR(double(flux[row * pitch + column]), physics.saturated_flux(0.4), 1e-6);
                EXPECT_EQ(turn[row * pitch + column], 0.0F);
            }
    }
}

// Sand below the angle of repose rests beside a wall at any angle, also if dust falls off the wall; above it
// slides along the wall.
TEST(Obstacle, SandRestsBesideWalls) {
    struct Case {
        double slope, dust; // tangent (of repose: 0.67), metres
    };
    for (const auto [slope, dust] : {Case{0.5, 0.0}, Case{0.5, 0.001}, Case{0.9, 0.0}}) {
        ObstacleField field(48, 48, 0.5, 0.0);
        field.blocks.turn = 0.6;
        field.blocks.box(-40.0, 40.0, -1.0, 60.0, -0.5, 0.5);
        const std::vector<double> heights = field.heights();
        for (int j = 0; j < 48; ++j)
            for (int i = 0; i < 48; ++i) { // falls along the wall
                const double along = std::cos(0.6) * field.domain.x(i) + std::sin(0.6) * field.domain.z(j);
                field.sand[field.domain.index(i, j)] = sand_units(20.0 - slope * along);
            }
        DuneSolverSettings settings;
        settings.border = DuneBorder::walled;
        static_cast<void>(field.solver(settings));
        for (size_t k = 0; k < heights.size(); ++k)
            if (heights[k] > 0.0) field.sand[k] = sand_units(dust);
        DuneSolver solver(field.domain, settings, field.rock.data(), field.sand.data());
        for (int step = 0; step < 20; ++step) solver.step({1.0, 0.0, 0.0}, 1.0);
        const std::vector<SandUnits> sand = obstacle_sand(solver, field);
        double worst = 0.0;
        for (size_t k = 0; k < sand.size(); ++k)
            if (heights[k] == 0.0) worst = std::max(worst, std::abs(sand_metres(sand[k] - field.sand[k])));
        std::printf("slope %.2f, dust %g m: moved %.2g m\n", slope, dust, worst);
        if (slope > 0.67)
            EXPECT_GT(worst, 0.05);
        else if (dust > 0.0) {
            EXPECT_GT(worst, 0.0);
            EXPECT_LT(worst, 4.0 * dust);
        } else
            EXPECT_EQ(worst, 0.0);
    }
}

} // namespace
} // namespace marram
