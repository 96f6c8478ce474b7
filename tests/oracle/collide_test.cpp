// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/collide.h"
#include "tests/oracle/promise.h"
#include "tests/oracle/test_shapes.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram::oracle {
namespace {

std::vector<Vec3d> straight(const Vec3d& root, const Vec3d& step, int count) {
    std::vector<Vec3d> cvs;
    for (int k = 0; k < count; ++k) cvs.push_back(root + k * step);
    return cvs;
}

void expect_lengths(const std::vector<Vec3d>& cvs, const std::vector<Vec3d>& rest) {
    for (size_t k = 0; k + 1 < rest.size(); ++k) {
        const double length = (rest[k + 1] - rest[k]).norm();
        EXPECT_NEAR((cvs[k + 1] - cvs[k]).norm(), length, 1e-14 * (1.0 + length));
    }
}

TEST(OracleCollide, WithoutCollidersEveryTargetIsReached) {
    Draw draw(61);
    const std::vector<Vec3d> rest = straight({0, 0, 0}, 0.1 * y, 9);
    std::vector<Vec3d> targets{rest[0]};
    for (int k = 0; k < 8; ++k) targets.push_back(targets.back() + 0.1 * draw.direction());
    const StrandTurn turn = collide_strand(rest, targets, std::vector<double>(8, 0.01), TriangleSet{});
    for (size_t k = 0; k < 9; ++k) EXPECT_LT((turn.cvs[k] - targets[k]).norm(), 1e-14);
    EXPECT_NEAR(turn.turned / turn.goal, 1.0, 1e-12);
    EXPECT_EQ(turn.unresolved, 0);
    const StrandTurn at_rest = collide_strand(rest, rest, std::vector<double>(8, 0.01), TriangleSet{});
    for (size_t k = 0; k < 9; ++k) EXPECT_LT((at_rest.cvs[k] - rest[k]).norm(), 1e-15);
    EXPECT_EQ(at_rest.goal, 0.0);
}

TEST(OracleCollide, SegmentsStartWhereTheTurnsNearerTheRootHaveCarriedThem) {
    // A straight strand that is blown flat rotates only at its root.
    const std::vector<Vec3d> rest = straight({0, 0, 0}, 0.1 * y, 6),
                             targets = straight({0, 0, 0}, 0.1 * x, 6);
    const StrandTurn turn = collide_strand(rest, targets, std::vector<double>(5, 0.0), TriangleSet{});
    EXPECT_NEAR(turn.segments[0].goal_angle, pi / 2, 1e-15);
    EXPECT_NEAR(turn.goal, pi / 2, 1e-14);
}

TEST(OracleCollide, AStrandPressedToTheFloorComesToLieOnIt) {
    // Root at height h, targets below the floor: the end of segment k stops at height c_k.
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    const double h = 0.1, l = 0.2;
    const std::vector<Vec3d> rest = straight({0, h, 0}, l * y, 6);
    std::vector<Vec3d> targets{rest[0]};
    for (int k = 1; k < 6; ++k) targets.push_back({0.2 * k, -0.1 * k, 0});
    const std::vector<double> c{0.05, 0.04, 0.03, 0.02, 0.01};
    const StrandTurn turn = collide_strand(rest, targets, c, ground, 1e-9);
    expect_lengths(turn.cvs, rest);
    for (size_t k = 0; k < 5; ++k) {
        EXPECT_NEAR(turn.cvs[k + 1].y(), c[k], 1e-9) << k;
        EXPECT_TRUE(turn.segments[k].contact.touches);
        EXPECT_FALSE(turn.segments[k].contact.grazes(1e-6));
        EXPECT_NEAR(turn.cvs[k + 1].z(), 0.0, 1e-15);
    }
    EXPECT_NEAR(turn.segments[0].angle, pi / 2 + std::asin((h - c[0]) / l), 1e-9);
    EXPECT_EQ(crossed_segments(turn.cvs, ground), 0);
    EXPECT_LT(turn.turned / turn.goal, 1.0);
    EXPECT_GT(turn.turned / turn.goal, 0.25) << "segments carried under the floor turn away from their goals";
}

TEST(OracleCollide, ASegmentCarriedInIsTurnedOutByTheSmallerTurn) {
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    const double h = 0.6, free = std::acos(h);
    const Vec3d start(std::sin(0.2), -std::cos(0.2), 0);
    // The goal is ahead (x) and free: the segment leaves by the shorter rotation and then reaches the goal.
    SegmentTurn turn = turn_segment({0, h, 0}, start, x, start, 1.0, 0.0, ground);
    EXPECT_FALSE(turn.start_free);
    EXPECT_NEAR(turn.out_angle, free - 0.2, 1e-9);
    EXPECT_NEAR(turn.remaining, 0.0, 1e-9);
    EXPECT_FALSE(turn.contact.touches);
    // The goal is behind, but the way out is shorter ahead: the segment leaves ahead, touches at once and
    // stays.
    const Vec3d goal(-std::sin(1.4), -std::cos(1.4), 0);
    turn = turn_segment({0, h, 0}, start, goal, start, 1.0, 0.0, ground);
    EXPECT_NEAR(turn.out_angle, free - 0.2, 1e-9);
    EXPECT_TRUE(turn.contact.touches);
    EXPECT_NEAR(turn.contact.angle, 0.0, 1e-9);
    EXPECT_NEAR(turn.remaining, 1.4 + free, 1e-9);
    EXPECT_NEAR(turn.angle, free - 0.2, 1e-9);
    // The goal is under the floor, ahead of the start: the segment leaves beyond the goal and stays.
    const Vec3d under(std::sin(0.5), -std::cos(0.5), 0);
    turn = turn_segment({0, h, 0}, start, under, start, 1.0, 0.0, ground);
    EXPECT_NEAR(turn.out_angle, free - 0.2, 1e-9);
    EXPECT_NEAR(turn.remaining, free - 0.5, 1e-9);
}

TEST(OracleCollide, WhereOnePlaneIsShutAnotherIsTriedAndAClosedBoxIsUnresolved) {
    std::vector<Triangle> box = box_mesh({-1, -1, -1}, {1, 1, 1});
    const Vec3d start = Vec3d(0.3, 0.9, 0.1).normalized();
    const SegmentTurn shut = turn_segment(Vec3d::Zero(), start, x, start, 3.0, 0.0, TriangleSet(box));
    EXPECT_TRUE(shut.unresolved);
    EXPECT_EQ((shut.direction - start).norm(), 0.0);
    std::erase_if(box, [](const Triangle& t) { return area_normal(t).z() > 0.0; });
    // The box without its lid at z = 1. The plane of start and goal does not meet the opening.
    const Vec3d up = Vec3d(0.3, 0.9, 0).normalized();
    const SegmentTurn open = turn_segment(Vec3d::Zero(), up, x, up, 3.0, 0.0, TriangleSet(box));
    EXPECT_FALSE(open.unresolved);
    EXPECT_FALSE(TriangleSet(box).any_crossing(Vec3d::Zero(), 3.0 * open.direction));
    EXPECT_GT(open.direction.z(), 0.5);
}

TEST(OracleCollide, ASheetThinnerThanAnyStepIsNotJumpedOver) {
    const TriangleSet sheet({{Vec3d(0.2, 0.5, -1), Vec3d(0.2, 0.5, 1), Vec3d(0.9, 0.5, 0)}});
    const std::vector<Vec3d> rest = straight({0, 0, 0}, y, 2), targets{{0, 0, 0}, {1, 0, 0}};
    const StrandTurn turn = collide_strand(rest, targets, {0.0}, sheet);
    EXPECT_TRUE(turn.segments[0].contact.touches);
    EXPECT_NEAR(turn.segments[0].angle, std::atan2(0.2, 0.5), 1e-9);
}

TEST(OracleCollide, SegmentsOfNoLengthAndOpposedGoalsAreFinite) {
    const TriangleSet ground(floor_mesh(-3.0, 10.0));
    const std::vector<Vec3d> rest{{0, 0, 0}, {0, 0, 0}, {0, 1, 0}, {0, 1, 0}};
    const std::vector<Vec3d> targets{{0, 0, 0}, {0, 0, 0}, {0, -1, 0}, {0, -1, 0}};
    const StrandTurn turn = collide_strand(rest, targets, {0.0, 0.0, 0.0}, ground);
    expect_lengths(turn.cvs, rest);
    EXPECT_NEAR((turn.cvs[2] - Vec3d(0, -1, 0)).norm(), 0.0, 1e-12);
    EXPECT_NEAR(turn.segments[1].angle, pi, 1e-12);
}

TEST(OracleCollide, FurOnABumpySphereCrossesNothingAndIsTheSameAtAnyScale) {
    auto bumpy = [](const Vec3d& u) {
        return 1.0 + 0.05 * std::sin(7.0 * u.x()) * std::cos(9.0 * u.y()) * std::sin(8.0 * u.z() + 1.0);
    };
    const std::vector<Triangle> mesh = sphere_mesh(60, bumpy);
    for (double scale : {1.0, 1e-4, 1e5}) {
        const TriangleSet set(moved(mesh, scale, Vec3d::Zero()));
        Draw draw(71);
        int crossed = 0, unresolved = 0, outs = 0;
        double turned = 0.0, goal = 0.0, polygon = 0.0;
        for (int i = 0; i < 60; ++i) {
            const Triangle& t = mesh[size_t(draw.below(int(mesh.size())))];
            const Vec3d normal = area_normal(t).normalized(), wind = (x + 0.1 * draw.in_cube()).normalized();
            const Vec3d root = scale * ((t.a + t.b + t.c) / 3.0 + 2e-3 * normal);
            const std::vector<Vec3d> rest = straight(root, scale * 0.05 * normal, 6);
            const std::vector<Vec3d> targets = straight(root, scale * 0.05 * wind, 6);
            std::vector<double> c;
            for (int k = 0; k < 5; ++k) c.push_back(scale * (1e-3 - 1e-9 * k));
            const StrandTurn turn = collide_strand(rest, targets, c, set);
            crossed += crossed_segments(turn.cvs, set);
            unresolved += turn.unresolved;
            for (const SegmentTurn& segment : turn.segments) outs += segment.start_free ? 0 : 1;
            turned += turn.turned, goal += turn.goal;
            for (size_t k = 0; k < 5; ++k)
                polygon =
                    std::max(polygon, c[k] - set.nearest(turn.cvs[k], turn.cvs[k + 1]).closest.distance);
        }
        std::printf(
            "  scale %g: %d segments turned out, %d unresolved, %d crossed, deepest %.1e, share %.6f\n",
            scale, outs, unresolved, crossed, polygon / scale, turned / goal);
        EXPECT_EQ(crossed, 0);
        EXPECT_EQ(unresolved, 0);
        EXPECT_LT(polygon / scale, 1e-12);
        EXPECT_NEAR(turned / goal, 0.55, 0.45);
    }
}

} // namespace
} // namespace marram::oracle
