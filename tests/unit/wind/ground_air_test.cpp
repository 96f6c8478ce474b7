// SPDX-License-Identifier: Apache-2.0
// The air over ground against the linear solution over a Gaussian ridge, and what a strand feels in a lee.
#include "procedural/air/ground_air.h"

#include "core/math/hash.h"
#include "procedural/air/separation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

namespace marram::testing::ground {
namespace {

struct Ground { // a mesh of a function of (x, z), metres
    std::vector<float> positions;
    std::vector<uint32_t> triangles;
    const float* list[1];
    MarramMesh mesh{};

    Ground(int nx, int nz, double cell, const std::function<double(double, double)>& height) {
        for (int j = 0; j < nz; ++j)
            for (int i = 0; i < nx; ++i) {
                const double x = (i - 0.5 * (nx - 1)) * cell, z = (j - 0.5 * (nz - 1)) * cell;
                positions.insert(positions.end(), {float(x), float(height(x, z)), float(z)});
            }
        for (int j = 0; j + 1 < nz; ++j)
            for (int i = 0; i + 1 < nx; ++i) {
                const auto a = uint32_t(j * nx + i), b = a + 1, c = a + uint32_t(nx), e = c + 1;
                triangles.insert(triangles.end(), {a, c, b, b, c, e});
            }
        list[0] = positions.data();
        mesh.positions = list;
        mesh.time_count = 1;
        mesh.vertex_count = uint32_t(positions.size() / 3);
        mesh.triangles = triangles.data();
        mesh.triangle_count = uint32_t(triangles.size() / 3);
    }
    Ground(const Ground&) = delete;
    Ground& operator=(const Ground&) = delete;
};

Vec3d wind_at_point(const GroundAir::At& at, const Vec3d& p, double above, const Vec3d& velocity,
                    const SpeedHeight& reference = {}) {
    const Wide3d v = wind_over_ground(at, reference, splat3(p.data()), splat(above), velocity);
    return {v.x[3], v.y[3], v.z[3]};
}

// Dawson's integral, by Rybicki's sum.
double dawson(double x) {
    constexpr double h = 0.1;
    double sum = 0.0;
    for (int n = -201; n <= 201; n += 2) sum += std::exp(-(x - n * h) * (x - n * h)) / n;
    return sum / std::sqrt(pi);
}

// tau' over H exp(-x^2 / 2 sigma^2), wind along x: A |k| + i B k of its Fourier transform, in closed form.
double stress_over_gaussian(double x, double height, double sigma) {
    const double t = x / (std::sqrt(2.0) * sigma);
    const double in_phase = height * std::sqrt(2.0 / pi) / sigma * (1.0 - 2.0 * t * dawson(t));
    return 3.5 * in_phase + 2.0 * -x / (sigma * sigma) * height * std::exp(-t * t);
}

TEST(HeightGrid, SamplesATerrainAtItsVertices) {
    const auto height = [](double x, double z) { return std::sin(0.3 * x) + 0.2 * z; };
    const Ground ground(301, 280, 0.4, height);
    const HeightGrid grid = heights_from_above(ground.mesh);
    ASSERT_EQ(grid.nx, 301);
    ASSERT_EQ(grid.nz, 280);
    EXPECT_NEAR(grid.cell, 0.4, 1e-6);
    for (int j = 0; j < grid.nz; ++j)
        for (int i = 0; i < grid.nx; ++i)
            ASSERT_NEAR(grid.heights[grid.index(i, j)], ground.positions[3 * grid.index(i, j) + 1], 1e-4);
}

TEST(HeightGrid, FillsHolesSmoothly) {
    Ground ground(300, 300, 1.0, [](double x, double) { return 0.1 * x; });
    std::vector<uint32_t> kept;
    for (size_t f = 0; f < ground.triangles.size() / 3; ++f) {
        const float* p = ground.positions.data() + 3 * size_t(ground.triangles[3 * f]);
        if (std::hypot(p[0], p[2]) > 20.0F)
            kept.insert(kept.end(),
                        {ground.triangles[3 * f], ground.triangles[3 * f + 1], ground.triangles[3 * f + 2]});
    }
    ground.triangles = kept;
    ground.mesh.triangles = kept.data();
    ground.mesh.triangle_count = uint32_t(kept.size() / 3);
    const HeightGrid grid = heights_from_above(ground.mesh);
    for (int j = 0; j < grid.nz; ++j)
        for (int i = 0; i < grid.nx; ++i)
            ASSERT_NEAR(grid.heights[grid.index(i, j)], 0.1 * (grid.x0 + i * grid.cell), 1.0);
}

TEST(HeightGrid, IsEmptyWithoutGround) {
    Ground wall(2, 2, 1.0, [](double, double) { return 0.0; });
    for (size_t v = 0; v < 4; ++v) wall.positions[3 * v] = 0.0F;
    EXPECT_TRUE(heights_from_above(wall.mesh).heights.empty());
    Ground broken(3, 3, 1.0, [](double, double) { return 0.0; });
    broken.positions[4] = NAN;
    EXPECT_TRUE(heights_from_above(broken.mesh).heights.empty());
    MarramMesh none{};
    EXPECT_TRUE(heights_from_above(none).heights.empty());
}

// Along the ridge's profile, the wind at any angle to the grid; and the speed from the stress.
TEST(GroundAir, HasTheStressOfLinearTheoryOverARidge) {
    constexpr double sigma = 8.0;
    for (const double steepest : {0.05, 0.15, 0.3}) {
        const double height = steepest * sigma * std::exp(0.5); // the slope is greatest at x = sigma
        const Ground ground(513, 129, 0.5, [&](double x, double) {
            return height * std::exp(-0.5 * x * x / (sigma * sigma));
        });
        const auto air = GroundAir::over(ground.mesh);
        const GroundAir::At at = air->at(Vec3d::UnitX(), false);
        const double most = stress_over_gaussian(-0.3 * sigma, height, sigma);
        double worst = 0.0, crest = 0.0;
        for (double x = -4.0 * sigma; x <= 4.0 * sigma; x += 0.37) {
            const double y = height * std::exp(-0.5 * x * x / (sigma * sigma)),
                         slope = -x / (sigma * sigma) * y;
            const Vec3d v = wind_at_point(at, {x, y, 1.7}, 0.1, {7.0, 0.0, 0.0});
            EXPECT_NEAR(v.z(), 0.0, 1e-3);
            EXPECT_NEAR(v.y() / v.x(), slope, 0.01 * steepest) << x;
            const double stress = v.squaredNorm() / 49.0 - 1.0;
            worst = std::max(worst, std::abs(stress - stress_over_gaussian(x, height, sigma)));
            crest = std::max(crest, v.norm() / 7.0);
        }
        std::printf("slope %.2f: stress off by %.2g of its greatest, speed-up of the crest %.3f\n", steepest,
                    worst / most, crest);
        EXPECT_LT(worst, 0.05 * most);
    }
}

// In the lee of a slip face the wind below the streamline that the solver's own separation finds is slow or returns;
// above it, it blows.
TEST(GroundAir, IsCalmBelowTheStreamlineOfALee) {
    const auto height = [](double x, double) { // windward slope 0.15, slip face of 32 degrees
        if (x < -20.0) return 0.0;
        if (x < 0.0) return 0.15 * (x + 20.0);
        return std::max(3.0 - 0.625 * x, 0.0);
    };
    const Ground ground(401, 101, 0.25, height);
    const auto air = GroundAir::over(ground.mesh);
    const GroundAir::At at = air->at(Vec3d::UnitX(), false);
    std::vector<float> profile(401), excess(401);
    const DownwindGrid course{401, 1, false, 0.25, false, 0.0};
    WideVector<float> rows(401 * 16 + 16), found(401 * 16 + 16);
    for (size_t i = 0; i < 401; ++i) rows[i * 16] = ground.positions[3 * i + 1];
    Separation().find(course, {}, rows.data(), 3.0, 16, found.data());
    int in_bubble = 0;
    for (int i = 0; i < 401; ++i) {
        const double x = (i - 200) * 0.25, e = double(found[size_t(i) * 16]),
                     ground_height = double(ground.positions[3 * size_t(i) + 1]);
        const auto wind = [&](double z) {
            return wind_at_point(at, {x, ground_height, 0.0}, z, {8.0, 0.0, 0.0});
        };
        if (e < 0.2) continue;
        ++in_bubble;
        EXPECT_LT(wind(0.0).x(), 0.0);
        EXPECT_NEAR(wind(0.0).norm(), return_flow * 8.0, 1e-6);
        EXPECT_LT(wind(0.3 * e).norm(), wind(e).norm());
        EXPECT_GT(wind(1.01 * e).x(), 0.0);
    }
    EXPECT_GT(in_bubble, 30);
    EXPECT_GT(wind_at_point(at, {-0.5, 2.9, 0.0}, 0.2, {8.0, 0.0, 0.0}).norm(), 1.2 * 8.0); // the crest
}

// The same ground turned about y has the same air turned; along a grid's axes and at any angle.
TEST(GroundAir, TurnsWithTheWind) {
    const auto hill = [](double x, double z) { return 3.0 * std::exp(-(x * x + z * z) / 128.0); };
    const Ground ground(257, 257, 0.5, hill);
    const auto air = GroundAir::over(ground.mesh);
    const auto relative = [&](double angle, double along, double across) {
        const Vec3d d(std::cos(angle), 0.0, std::sin(angle)), side(-d.z(), 0.0, d.x());
        const Vec3d p = along * d + across * side;
        const Vec3d v = wind_at_point(air->at(d, false), {p.x(), hill(p.x(), p.z()), p.z()}, 0.1, 5.0 * d);
        return Vec3d(v.dot(d), v.y(), v.dot(side));
    };
    double worst = 0.0, turned = 0.0;
    for (double angle = -3.0; angle < 3.2; angle += 0.37)
        for (const double along : {-9.0, -3.0, 0.0, 4.0})
            for (const double across : {-7.0, 0.0, 5.0}) {
                const Vec3d at_angle = relative(angle, along, across), at_zero = relative(0.0, along, across);
                worst = std::max(worst, (at_angle - at_zero).norm());
                turned = std::max(turned, std::abs(at_zero.z()));
            }
    std::printf("turned with the wind: off by %.2g m/s of 5; air turns by up to %.2g m/s\n", worst, turned);
    EXPECT_LT(worst, 0.15);
    EXPECT_GT(turned, 0.2);
}

// A wind that turns in time: the mean of two directions, continuous, and close to the steady one.
TEST(GroundAir, IsContinuousInTheDirection) {
    const Ground ground(257, 257, 0.5,
                        [](double x, double z) { return 3.0 * std::exp(-(x * x + 0.3 * z * z) / 128.0); });
    const auto air = GroundAir::over(ground.mesh);
    Vec3d before;
    double jump = 0.0, off = 0.0;
    for (int k = 0; k <= 4000; ++k) {
        const double angle = k * 2.0 * pi / 4000.0;
        const Vec3d d(std::cos(angle), 0.0, std::sin(angle)), p(3.0, 2.5, -4.0);
        const Vec3d v = wind_at_point(air->at(d, true), p, 0.1, 5.0 * d);
        if (k > 0) jump = std::max(jump, (v - before).norm());
        before = v;
        if (k % 100 == 50)
            off = std::max(off, (v - wind_at_point(air->at(d, false), p, 0.1, 5.0 * d)).norm());
    }
    std::printf("a turn by 0.09 degrees changes the wind by %.2g m/s of 5, two directions are off by %.2g\n",
                jump, off);
    EXPECT_LT(jump, 0.03);
    EXPECT_LT(off, 0.2);
}

TEST(GroundAir, FollowsTheLogarithmicLaw) {
    const Ground ground(257, 257, 0.5, [](double, double) { return 2.0; });
    const auto air = GroundAir::over(ground.mesh);
    const GroundAir::At at = air->at({1.0, 0.0, 1.0}, false);
    const Vec3d wind(4.0, 0.5, 4.0);
    EXPECT_NEAR((wind_at_point(at, {0.0, 2.0, 0.0}, 0.4, wind) - wind).norm(), 0.0, 1e-5);
    const double share = std::log(1.0 + 0.4 / 0.01) / std::log(1.0 + 10.0 / 0.01);
    const Vec3d slow = wind_at_point(at, {0.0, 2.0, 0.0}, 0.4, wind, {10.0, 0.01});
    EXPECT_NEAR((slow - Vec3d(4.0 * share, 0.5, 4.0 * share)).norm(), 0.0, 1e-5);
    EXPECT_EQ(wind_at_point(at, {1000.0, 0.0, 0.0}, 0.4, wind), wind); // beyond the grid
    EXPECT_NEAR((wind_at_point(at, {1000.0, 0.0, 0.0}, 0.4, wind, {10.0, 0.01}) - slow).norm(), 0.0, 1e-5);
    EXPECT_EQ(air->at(Vec3d::UnitY(), false).air, nullptr);
}

} // namespace
} // namespace marram::testing::ground
