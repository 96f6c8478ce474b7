// SPDX-License-Identifier: Apache-2.0
// Wakes behind plants: the formula at any angle to the grid, borders, and the sand that gathers in them.
#include "core/math/vec.h"
#include "procedural/terrain/solver/solver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace marram {
namespace {

constexpr double wake_drag = 16.0;

// Plants by cell, and what Wake makes of them; rows along z, columns along x.
struct WakeField {
    DownwindGrid grid;
    WideVector<float> area;
    WideVector<double> height;
    WideVector<float> deficit;

    explicit WakeField(const DownwindGrid& at)
        : grid(at), area(pitch() * size_t(at.rows), 0.0F), deficit(area.size(), 0.0F) {}
    size_t pitch() const { return size_t(Shear::pitch(grid.columns)); }
    float& plants(int row, int column) { return area[size_t(row) * pitch() + size_t(column)]; }
    double at(int row, int column) const { return double(deficit[size_t(row) * pitch() + size_t(column)]); }
    void find(double recovery, double full_height) {
        Wake wake;
        wake.find(grid, recovery,
                  {area.data(), height.empty() ? nullptr : height.data(), full_height, wake_drag}, pitch(),
                  deficit.data());
    }
};

double wake_own(double area) { return 1.0 - 1.0 / std::sqrt(1.0 + wake_drag * area); }

// A band of plants across the wind, which crosses the grid at four angles, forwards and backwards.
TEST(Wake, RecoversByOkinsFormulaAtAnyAngle) {
    for (const double drift : {0.0, 0.3, -0.5, 1.0})
        for (const bool backwards : {false, true}) {
            WakeField field({96, 80, false, 0.25, backwards, drift});
            const double size = std::hypot(1.0, drift);
            const auto distance = [&](int row, int column) { // along the wind, metres
                const int step = backwards ? 95 - row : row;
                return 0.25 * ((step - 30) + drift * (column - 40)) / size;
            };
            for (int row = 0; row < 96; ++row)
                for (int column = 0; column < 80; ++column)
                    if (std::abs(distance(row, column)) <= 1.0) field.plants(row, column) = 0.2F;
            field.find(2.1, 1.5);
            double worst = 0.0;
            for (int row = 4; row < 92; ++row)
                for (int column = 4; column < 76; ++column) {
                    const double d = distance(row, column), past = d - 1.0;
                    if (d < -1.0 - 0.25 * size) {
                        // Rays that start beside the band's corner meet nothing upwind of it.
                        if (std::abs(drift) <= 0.3) {
                            EXPECT_EQ(field.at(row, column), 0.0) << row << ' ' << column;
                        }
                    } else if (past > 0.5 && past < 9.0 && std::abs(column - 40) < 12) {
                        const double right = wake_own(0.2) * std::exp(-past / (2.1 * 1.5));
                        worst = std::max(worst, std::abs(field.at(row, column) / right - 1.0));
                    }
                }
            // The band's edge is known to a cell: 0.25 m of 3.15 m.
            EXPECT_LT(worst, 0.12) << drift << backwards;
            if (drift == 0.0) {
                EXPECT_LT(worst, 1e-5);
            }
        }
}

TEST(Wake, TheLargerDeficitCountsAndHeightsDiffer) {
    WakeField field({60, 32, false, 1.0, false, 0.0});
    field.height.assign(field.area.size(), 1.0);
    for (int column = 0; column < 32; ++column) {
        field.plants(5, column) = 1.0F; // high
        field.height[5 * field.pitch() + size_t(column)] = 4.0;
        field.plants(10, column) = 0.01F; // in its wake, with less deficit
        field.plants(40, column) = 1.0F;  // low
    }
    field.find(2.0, 4.0);
    for (int row = 6; row < 40; ++row)
        EXPECT_NEAR(field.at(row, 8), wake_own(1.0) * std::exp(-(row - 5) / 8.0), 1e-5) << row;
    EXPECT_NEAR(field.at(43, 8), wake_own(1.0) * std::exp(-3.0 / 2.0), 1e-5);
    EXPECT_EQ(field.at(4, 8), 0.0);
}

// Dead plants have no height and no deficit; live ones between them keep their wakes, with winds at any
// angle.
TEST(Wake, DeadPlantsChangeNothing) {
    for (const double drift : {0.0, 0.3, -0.7})
        for (const double recovery : {1.0, 2.1, 5.0})
            for (const double cell : {0.25, 0.5, 10.0}) {
                std::array<WakeField, 2> fields{WakeField({40, 48, false, cell, false, drift}),
                                                WakeField({40, 48, false, cell, false, drift})};
                for (size_t k = 0; k < 2; ++k) {
                    WakeField& field = fields[k];
                    field.height.assign(field.area.size(), k == 0 ? 0.0 : 1e-12);
                    for (int column = 20; column < 28; ++column) {
                        field.plants(8, column) = 0.2F;
                        field.height[8 * field.pitch() + size_t(column)] = 0.8;
                    }
                    field.find(recovery, 1.0);
                }
                double most = 0.0;
                for (int row = 0; row < 40; ++row)
                    for (int column = 0; column < 48; ++column) {
                        EXPECT_EQ(fields[0].at(row, column), fields[1].at(row, column));
                        most = std::max(most, fields[0].at(row, column));
                    }
                EXPECT_NEAR(most, wake_own(0.2), 1e-5);
                EXPECT_LE(most, 1.0);
            }
}

// On periodic ground an oblique wake goes around more than once: as on the same pattern, repeated.
TEST(Wake, GoesAroundAnObliqueWindMoreThanOnce) {
    WakeField small({8, 32, true, 0.25, false, 0.5}), tiled({64, 32, true, 0.25, false, 0.5});
    for (int row = 0; row < 64; ++row)
        for (int column = 0; column < 32; ++column) {
            const float area = (row % 8 == 3 && column % 16 == 5) ? 0.5F : 0.0F;
            tiled.plants(row, column) = area;
            if (row < 8) small.plants(row, column) = area;
        }
    small.find(4.0, 2.0), tiled.find(4.0, 2.0);
    for (int row = 0; row < 8; ++row)
        for (int column = 0; column < 32; ++column)
            EXPECT_NEAR(small.at(row, column), tiled.at(row, column), 2e-3) << row << ' ' << column;
}

TEST(Wake, GoesAroundAPeriodicBorderOnly) {
    for (const bool periodic : {false, true}) {
        WakeField field({40, 32, periodic, 1.0, false, 0.0});
        for (int column = 0; column < 32; ++column) field.plants(38, column) = 0.5F;
        field.find(2.0, 2.0);
        EXPECT_NEAR(field.at(2, 7), periodic ? wake_own(0.5) * std::exp(-1.0) : 0.0, 1e-5);
    }
}

// Tufts in a stream of sand over hard ground: without wakes a hummock in each tuft, with them a tail behind
// it.
TEST(Wake, SandGathersInATailBehindATuft) {
    const Domain domain{96, 48, 0.25, 0.0, 0.0};
    std::vector<float> rock(domain.count(), 0.0F), plants(domain.count(), 0.0F);
    const std::vector<SandUnits> bare(domain.count(), 0);
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i)
            if (std::hypot(i - 28, j - 24) <= 4.0) plants[domain.index(i, j)] = 1.0F; // radius 1 m
    const auto run = [&](double wake, int angle) {
        DuneSolverSettings settings;
        settings.border = DuneBorder::open;
        settings.influx = 0.6;
        settings.growth.frontal_area = 0.6, settings.growth.height = 0.6, settings.growth.wake = wake;
        DuneSolver solver(domain, settings, rock.data(), bare.data(), plants.data());
        solver.advance(steady_wind({std::cos(angle * degree), std::sin(angle * degree), 0.35}),
                       240.0 * seconds_per_hour);
        std::vector<SandUnits> sand(domain.count());
        solver.sand(sand);
        EXPECT_EQ(std::accumulate(sand.begin(), sand.end(), SandUnits(0)) + solver.out() - solver.in(), 0);
        return sand;
    };
    const auto behind = [&](const std::vector<SandUnits>& sand, double metres) { // the end of the tuft
        return sand_metres(sand[domain.index(28 + int(std::lround((1.0 + metres) / 0.25)), 24)]);
    };
    const std::vector<SandUnits> none = run(0.0, 0), tail = run(2.1, 0);
    for (const double metres : {-1.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0})
        std::printf("%5.2f m behind the tuft: %.3f m without wakes, %.3f m with\n", metres,
                    behind(none, metres), behind(tail, metres));
    EXPECT_GT(behind(none, -1.0), 0.1);
    EXPECT_GT(behind(tail, -1.0), 0.1);
    EXPECT_LT(behind(none, 0.5), 0.002);
    EXPECT_GT(behind(tail, 0.5), 0.03);
    EXPECT_GT(behind(tail, 1.0), 0.01);
    EXPECT_LT(behind(tail, 8.0), 0.002);
    double across = 0.0; // the order in which cells slide is not symmetric
    for (size_t row = 1; row < 48; ++row)
        for (size_t column = 0; column < 96; ++column)
            across = std::max(across, std::abs(sand_metres(tail[row * 96 + column]) -
                                               sand_metres(tail[(48 - row) * 96 + column])));
    EXPECT_LT(across, 0.01);
}

} // namespace
} // namespace marram
