// SPDX-License-Identifier: Apache-2.0
#include "procedural/erosion/empty_space.h"

#include "core/math/hash.h"
#include "grain_cases.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram::testing {
namespace {

constexpr double ball_radius = 0.7;

// The radius of the ball around p that is known to be empty: how far a straight path gets in one step.
double empty_radius(const EmptySpace& empty, const Vec3d& p) {
    ParabolaPair pair{};
    Parabolas8& paths = pair[1];
    for (int axis = 0; axis < 3; ++axis) paths.x[axis][3] = float(p[axis] - empty.low()[axis]);
    paths.v[1][3] = 1.0F;
    paths.t_max[3] = 1e6F;
    empty.step(pair, 1);
    if (!(paths.t_clear[3] > 0.0F)) {
        EXPECT_EQ(paths.is_near[3], -1) << "it needs a ray";
    }
    return double(paths.t_clear[3]);
}

Vec3d point_in(const Eigen::AlignedBox3d& box, uint64_t k) {
    return box.min() + Vec3d(unit_double(hash(k, 1)), unit_double(hash(k, 2)), unit_double(hash(k, 3)))
                           .cwiseProduct(box.sizes());
}

TEST(EmptySpace, IsNeverTooLargeAndAFewCellsTooSmall) {
    const Vec3d centre(30.0, -2.0, 5.0);
    GrainScene scene;
    scene.add(grain_sphere(centre, ball_radius, 64));
    scene.commit();
    for (const int cells : {1, 2, 7, 32, 100}) {
        const Eigen::AlignedBox3d box(centre - Vec3d(1.5, 1.0, 2.0), centre + Vec3d(1.0, 2.5, 1.2));
        const EmptySpace empty(scene.get(), box, cells);
        const double cell = box.sizes().maxCoeff() / cells;
        double most = 0.0, near = 0.0, near_points = 0.0; // how much it is too small: most, sum near the ball
        for (uint64_t k = 0; k < 20000; ++k) {
            // Also outside the box.
            const Eigen::AlignedBox3d wide(box.min() - box.sizes(), box.max() + box.sizes());
            const Vec3d p = point_in(k % 2 == 0 ? box : wide, k);
            const double nearest = std::abs((p - centre).norm() - ball_radius);
            const double radius = empty_radius(empty, p);
            ASSERT_LT(radius, nearest + 1e-3 * ball_radius) << cells; // the facets are below the ball
            if (!box.contains(p) || nearest > 30.0 * cell) continue;
            most = std::max(most, nearest - radius);
            if (nearest > 0.5 * cell && nearest < 2.0 * cell) near += nearest - radius, near_points += 1.0;
        }
        constexpr double leaf = 0.1 * ball_radius; // of the BVH
        EXPECT_LT(most, 3.5 * cell + leaf) << cells;
        EXPECT_LT(near / near_points, 0.7 * cell + 0.5 * leaf) << cells;
    }
}

TEST(EmptySpace, AStepStaysInsideTheBall) {
    const Vec3d centre(0.0, 0.0, 0.0);
    GrainScene scene;
    scene.add(grain_sphere(centre, ball_radius, 32));
    scene.commit();
    const Eigen::AlignedBox3d box(Vec3d::Constant(-2.0), Vec3d::Constant(2.0));
    const EmptySpace empty(scene.get(), box, 40);
    for (uint64_t k = 0; k < 2000; ++k) {
        const Vec3d p = point_in(box, k), v = 10.0 * (point_in(box, k + 77777));
        const double gravity = 9.81 * unit_double(hash(k, 9));
        ParabolaPair pair{};
        Parabolas8& paths = pair[0];
        for (int axis = 0; axis < 3; ++axis)
            paths.x[axis][0] = float(p[axis] - empty.low()[axis]), paths.v[axis][0] = float(v[axis]);
        paths.gravity = float(gravity), paths.t_max[0] = 10.0F;
        const double radius = empty_radius(empty, p);
        empty.step(pair, 1);
        const auto t = double(paths.t_clear[0]);
        const Vec3d way = t * v - 0.5 * gravity * t * t * Vec3d::UnitY();
        EXPECT_LE(way.norm(), radius * (1.0 + 1e-5) + 1e-6);
        empty.step(pair, 1);
        const float twice = paths.t_clear[0];
        paths.t_clear[0] = 0.0F;
        empty.step(pair, 2);
        EXPECT_EQ(paths.t_clear[0], twice);
    }
}

TEST(EmptySpace, NothingIsKnownOfNothing) {
    const Vec3d points[] = {{1.0, 2.0, 3.0}, {-1.0, 2.0, 3.0}, {-1.0, -2.0, -3.0}};
    const EmptySpace none;
    for (const Vec3d& p : points) EXPECT_EQ(empty_radius(none, p), 0.0);
    GrainScene scene;
    scene.add(grain_sphere(Vec3d::Zero(), 1.0, 4));
    scene.commit();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const Eigen::AlignedBox3d point(Vec3d::Zero(), Vec3d::Zero());
    const Eigen::AlignedBox3d tiny(Vec3d::Zero(), Vec3d::Constant(1e-38));
    for (const Eigen::AlignedBox3d& box : {point, tiny})
        for (const Vec3d& p : points) EXPECT_EQ(empty_radius(EmptySpace(scene.get(), box, 64), p), 0.0);
    const EmptySpace empty(scene.get(), Eigen::AlignedBox3d(Vec3d::Constant(-2.0), Vec3d::Constant(2.0)), 10);
    EXPECT_EQ(empty_radius(empty, Vec3d(nan, nan, nan)), 0.0);
}

} // namespace
} // namespace marram::testing
