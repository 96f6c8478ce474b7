// SPDX-License-Identifier: Apache-2.0
// Offset scale: where targets are pushed to, and that they do not jump as the wind moves them.
#include "procedural/wind/collision/skin.h"

#include "tests/chain/furred_collision.h"
#include "tests/oracle/offset_scale.h"
#include "tests/oracle/test_shapes.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {

TEST(Skin, PushesTargetsWhereTheOracleDoes) {
    std::vector<Mesh> meshes = {sphere_mesh(1.0F, 30, 0.05F, 7.0F)};
    const oracle::TriangleSet set = triangle_set(meshes);
    const FurredWorld world(std::move(meshes));
    const Colliders colliders = world.colliders();
    oracle::Draw draw(5);
    double worst = 0.0;
    int pushed = 0, on_edge = 0, skipped = 0;
    for (int i = 0; i < 2000; ++i) {
        const Vec3d up = draw.direction();
        const std::vector<Vec3d> rest = {up * 1.1, up * 1.25},
                                 bent = {rest[0], rest[0] + 0.2 * draw.direction()};
        const double scale = draw.unit();
        const oracle::Pushed expected = oracle::push_targets(rest, bent, up, scale, set);
        uint32_t hint = no_triangle;
        Vec3d p = bent[1];
        const bool done = raise_to_min_height(colliders, world.mesh(0), rest[1], up, 0.5, scale, hint, p);
        EXPECT_EQ(done, expected.skipped == 0);
        skipped += expected.skipped;
        pushed += expected.push[1] > 0.0;
        on_edge += expected.on_edge[1];
        if (!expected.on_edge[1]) worst = std::max(worst, (p - expected.cvs[1]).norm());
    }
    std::printf("%d of 2000 targets pushed, off by %.2g m at worst; %d on an edge, %d skipped\n", pushed,
                worst, on_edge, skipped);
    EXPECT_GT(pushed, 500);
    EXPECT_LT(worst, 1e-9);
}

// Faces perpendicular to the facing direction: rounding decides whether they face it, but rejected faces must
// not hide those behind.
TEST(Skin, FindsAFootWhereFacesStandAcrossTheDirectionAskedFor) {
    Mesh prism; // a square on its corner
    for (const float z : {-1.0F, 1.0F})
        for (const Vec2f& at : {Vec2f(1, 0), Vec2f(0, 1), Vec2f(-1, 0), Vec2f(0, -1)})
            prism.positions.emplace_back(at.x(), at.y(), z);
    for (uint32_t i = 0; i < 4; ++i) {
        const uint32_t j = (i + 1) % 4;
        prism.triangles.push_back({i, j, j + 4});
        prism.triangles.push_back({i, j + 4, i + 4});
    }
    std::vector<Mesh> meshes = {prism};
    const oracle::TriangleSet set = triangle_set(meshes);
    const FurredWorld world(std::move(meshes));
    const Colliders colliders = world.colliders();
    const Vec3d facing = Vec3d(1, 1, 0) / std::sqrt(2.0);
    oracle::Draw draw(3);
    double worst = 0.0;
    for (int i = 0; i < 5000; ++i) {
        const Vec3d p = 0.6 * draw.in_cube();
        SkinPoint closest;
        ASSERT_TRUE(closest_skin_point(colliders, world.mesh(0), p, facing, 3.0, no_triangle, closest))
            << p.transpose();
        worst = std::max(worst, std::abs(std::abs(closest.height) -
                                         std::abs(oracle::closest_on_skin(p, facing, set).height)));
        SkinPoint hinted;
        ASSERT_TRUE(closest_skin_point(colliders, world.mesh(0), p, facing, 3.0, 0, hinted));
        EXPECT_EQ(hinted.height, closest.height);
    }
    EXPECT_LT(worst, 1e-12);
}

TEST(Skin, PushedTargetsStandHighEnoughAndFollowWithoutJumps) {
    // Coarse, so that the normals of adjacent facets differ by ten degrees or more.
    const FurredWorld world({sphere_mesh(1.0F, 10, 0.05F, 7.0F)});
    const Colliders colliders = world.colliders();
    oracle::Draw draw(11);
    constexpr double length = 0.2, scale = 0.4;
    constexpr int strands = 2000, steps = 200;
    double lowest = 1.0, fastest = 0.0;
    int pushed = 0, jumps = 0, asked = 0;
    for (int i = 0; i < strands; ++i) {
        const Vec3d up = draw.direction();
        const Vec3d rest = up * (1.08 + 0.9 * length);
        const Vec3d side = up.cross(draw.direction()).normalized();
        uint32_t hint = no_triangle;
        Vec3d before = Vec3d::Zero();
        for (int s = 0; s <= steps; ++s) {
            // Blown sideways and down, into the body.
            const double angle = 1.9 * s / steps;
            Vec3d p = up * 1.08 + 0.9 * length * (up * std::cos(angle) + side * std::sin(angle));
            const Vec3d asked_at = p;
            if (!raise_to_min_height(colliders, world.mesh(0), rest, up, 2.0 * length, scale, hint, p))
                continue;
            SkinPoint at_rest, now;
            ASSERT_TRUE(closest_skin_point(colliders, world.mesh(0), rest, up, 1.0, no_triangle, at_rest));
            ASSERT_TRUE(
                closest_skin_point(colliders, world.mesh(0), p, at_rest.normal, 1.0, no_triangle, now));
            lowest = std::min(lowest, now.height / (scale * at_rest.height));
            pushed += p != asked_at;
            if (s > 0) {
                const double pace = (p - before).norm() / (0.9 * length * 1.9 / steps);
                fastest = std::max(fastest, pace);
                jumps += pace > 4.0;
                ++asked;
            }
            before = p;
        }
    }
    std::printf("%d of %d targets pushed; at least %.3f of the height asked for; %d go over 4 times as fast "
                "as the wind "
                "moves them, the fastest %.1f times\n",
                pushed, asked, lowest, jumps, fastest);
    EXPECT_GT(pushed, asked / 20);
    EXPECT_GT(lowest, 0.9);
    EXPECT_EQ(jumps, 0);
    EXPECT_LT(fastest, 3.0);
}

} // namespace marram
