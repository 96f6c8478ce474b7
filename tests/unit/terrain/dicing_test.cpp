// SPDX-License-Identifier: Apache-2.0
// Triangles refined near a camera: no cracks, full coverage, no more triangles than needed.
#include "procedural/terrain/mesh/dicing.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

namespace marram {
namespace {

std::vector<Vec3d> all_positions(const std::vector<Vec3d>& given, const DicedMesh& mesh) {
    std::vector<Vec3d> positions = given;
    for (const auto& [a, b] : mesh.midpoints) {
        EXPECT_LT(std::max(a, b), positions.size());
        positions.emplace_back(0.5 * (positions[a] + positions[b]));
    }
    return positions;
}

// Number of triangles at each edge.
std::map<std::pair<uint32_t, uint32_t>, int> sides_of(std::span<const uint32_t> triangles) {
    std::map<std::pair<uint32_t, uint32_t>, int> sides;
    for (size_t t = 0; t < triangles.size(); t += 3)
        for (size_t k = 0; k < 3; ++k) ++sides[std::minmax(triangles[t + k], triangles[t + (k + 1) % 3])];
    return sides;
}

double area_of(const std::vector<Vec3d>& positions, std::span<const uint32_t> triangles) {
    double area = 0.0;
    for (size_t t = 0; t < triangles.size(); t += 3) {
        const Vec3d &a = positions[triangles[t]], &b = positions[triangles[t + 1]],
                    &c = positions[triangles[t + 2]];
        const Vec3d twice = (b - a).cross(c - a);
        EXPECT_GT(twice.y(), 0.0); // no triangle is flipped
        area += 0.5 * twice.norm();
    }
    return area;
}

// A bumpy square of n x n cells.
struct Ground {
    std::vector<Vec3d> positions;
    std::vector<uint32_t> triangles;

    Ground(uint32_t n, double cell, double bump) {
        for (uint32_t j = 0; j <= n; ++j)
            for (uint32_t i = 0; i <= n; ++i)
                positions.emplace_back(cell * i, bump * unit_double(hash(i, j)), cell * j);
        for (uint32_t j = 0; j < n; ++j)
            for (uint32_t i = 0; i < n; ++i) {
                const uint32_t a = j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
                triangles.insert(triangles.end(), {a, c, b, b, c, d});
            }
    }
};

DisplacedRegion region_at(const Vec3d& camera, const Vec3d& forward, double reach, double side) {
    DisplacedRegion region;
    region.cameras = {{camera, forward.normalized()}};
    region.corner = 30.0 * degree;
    region.reach = reach;
    region.side = side;
    return region;
}

TEST(Dicing, HasNoCracksAndLeavesNoSideTooLong) {
    size_t most = 0;
    for (const uint32_t cells : {1U, 3U, 20U})
        for (const double side : {0.05, 0.31}) {
            const double cell = 24.0 / cells;
            const Ground ground(cells, cell, 0.2 * cell);
            const DisplacedRegion region = region_at({11.0, 2.0, 13.0}, {1.0, -0.3, 0.4}, 4.0, side);
            const DicedMesh mesh = dice(ground.positions, ground.triangles, region);
            EXPECT_EQ(mesh.reach, 4.0);
            const std::vector<Vec3d> positions = all_positions(ground.positions, mesh);
            EXPECT_NEAR(area_of(positions, mesh.triangles), area_of(ground.positions, ground.triangles),
                        1e-6);
            // An edge has two triangles or lies on the border. The border keeps its total length.
            const auto before = sides_of(ground.triangles);
            double border = 0.0, border_before = 0.0;
            for (const auto& [ends, count] : sides_of(mesh.triangles)) {
                ASSERT_LE(count, 2);
                if (count == 1) border += (positions[ends.first] - positions[ends.second]).norm();
                const Vec3d middle = 0.5 * (positions[ends.first] + positions[ends.second]);
                const double length = (positions[ends.first] - positions[ends.second]).norm();
                if (region.share(middle) > 0.0) {
                    ASSERT_LE(length, side);
                }
            }
            for (const auto& [ends, count] : before)
                if (count == 1) border_before += (positions[ends.first] - positions[ends.second]).norm();
            EXPECT_NEAR(border, border_before, 1e-9);
            // No duplicate points.
            std::set<std::array<double, 3>> places;
            for (const Vec3d& p : positions) places.insert({p.x(), p.y(), p.z()});
            EXPECT_EQ(places.size(), positions.size());
            most = std::max(most, mesh.triangles.size() / 3);
        }
    std::printf("[ dicing ] %zu triangles at most\n", most);
    EXPECT_LT(most, 40000U); // about 10 m^2 visible; triangles of 2.5 to 5 cm have 3 to 11 cm^2
}

TEST(Dicing, DoesNotDependOnTheOrder) {
    const Ground ground(8, 3.0, 0.5);
    const DisplacedRegion region = region_at({11.0, 2.0, 13.0}, {1.0, -0.3, 0.4}, 4.0, 0.2);
    std::vector<uint32_t> turned = ground.triangles;
    for (size_t t = 0; t < turned.size() / 2; t += 3)
        std::swap_ranges(turned.begin() + long(t), turned.begin() + long(t) + 3, turned.end() - long(t) - 3);
    for (size_t t = 0; t < turned.size(); t += 6) std::rotate(&turned[t], &turned[t] + 1, &turned[t] + 3);
    const auto corners = [&](std::span<const uint32_t> triangles) {
        const DicedMesh mesh = dice(ground.positions, triangles, region);
        const std::vector<Vec3d> positions = all_positions(ground.positions, mesh);
        std::set<std::array<double, 9>> all;
        for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
            std::array<std::array<double, 3>, 3> three{};
            for (size_t k = 0; k < 3; ++k) {
                const Vec3d& p = positions[mesh.triangles[t + k]];
                three[k] = {p.x(), p.y(), p.z()};
            }
            std::rotate(three.begin(), std::min_element(three.begin(), three.end()), three.end());
            std::array<double, 9> flat{};
            for (size_t k = 0; k < 9; ++k) flat[k] = three[k / 3][k % 3];
            all.insert(flat);
        }
        return all;
    };
    EXPECT_EQ(corners(ground.triangles), corners(turned));
}

TEST(Dicing, ReachesLessWhereThereWouldBeTooMany) {
    const Ground ground(4, 10.0, 0.0);
    const DisplacedRegion region = region_at({20.0, 1.5, 20.0}, {1.0, -0.2, 0.0}, 20.0, 0.05);
    const DicedMesh mesh = dice(ground.positions, ground.triangles, region, 20000);
    EXPECT_LE(mesh.triangles.size() / 3, 20000U);
    EXPECT_GT(mesh.triangles.size() / 3, 5000U);
    EXPECT_LT(mesh.reach, 20.0);
    EXPECT_GT(mesh.reach, 1.0);
    EXPECT_EQ(dice(ground.positions, ground.triangles, region, 1).triangles, ground.triangles);
}

TEST(Dicing, LeavesAloneWhatTheCameraDoesNotSee) {
    const Ground ground(4, 10.0, 0.0);
    for (const auto& [camera, forward] : {std::pair(Vec3d(20.0, 40.0, 20.0), Vec3d(0.0, -1.0, 0.0)),
                                          std::pair(Vec3d(20.0, 1.0, 20.0), Vec3d(0.0, 1.0, 0.0)),
                                          std::pair(Vec3d(-60.0, 1.0, 20.0), Vec3d(1.0, 0.0, 0.0))}) {
        const DicedMesh mesh =
            dice(ground.positions, ground.triangles, region_at(camera, forward, 9.0, 0.05));
        EXPECT_LT(mesh.midpoints.size(),
                  40U); // around the camera: the balls reach into its view
    }
}

TEST(Dicing, ShareFadesWithoutAStep) {
    const DisplacedRegion region = region_at({0.0, 2.0, 0.0}, {1.0, -0.2, 0.0}, 8.0, 0.05);
    EXPECT_EQ(region.share({3.5, 1.0, 0.0}), 1.0);
    EXPECT_EQ(region.share({8.5, 0.0, 0.0}), 0.0);
    EXPECT_EQ(region.share({-3.0, 1.0, 0.0}), 0.0); // behind
    EXPECT_EQ(region.share({0.0, 2.0, 0.0}), 1.0);  // at the camera
    double step = 0.0, before = region.share({0.0, 1.5, 0.0});
    for (double x = 0.0; x < 10.0; x += 0.001) {
        const double share = region.share({x, 1.5, 0.1});
        if (x > 1.0) step = std::max(step, std::abs(share - before));
        before = share;
    }
    EXPECT_LT(step, 0.001); // 1.5 / 4 m for the smooth step
    EXPECT_GT(step, 0.0);
}

} // namespace
} // namespace marram
