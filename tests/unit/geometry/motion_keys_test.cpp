// SPDX-License-Identifier: Apache-2.0
// One dial that the tolerance turns: the number of motion keys.
#include "core/geometry/build.h"

#include <gtest/gtest.h>

#include <cstdio>

using namespace marram;

namespace {

// A box of 2 m that turns by `degrees` about y within frame 1 ... 2, and is moved along by 3 m.
SceneGeometry turning_box(double degrees) {
    SceneGeometry geometry;
    SceneMesh mesh;
    mesh.name = "box";
    mesh.mesh = box_mesh(Vec3f(2.0F, 2.0F, 2.0F));
    mesh.transform = KeyedTransform(
        std::vector<double>{1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 2, 3, 0, 0, 0, degrees, 0, 1, 1, 1}, "linear");
    geometry.meshes.push_back(std::move(mesh));
    return geometry;
}

} // namespace

TEST(MotionKeys, two_are_enough_for_a_straight_line) {
    EXPECT_EQ(motion_keys_for(turning_box(0.0), 1e-6, 1.0, 2.0), 2U);
    EXPECT_EQ(motion_keys_for(SceneGeometry{}, 1e-6, 1.0, 2.0), 2U);
}

TEST(MotionKeys, nothing_moves_while_the_shutter_is_closed_or_the_shot_is_over) {
    EXPECT_EQ(motion_keys_for(turning_box(90.0), 1e-6, 1.5, 1.5), 2U);
    EXPECT_EQ(motion_keys_for(turning_box(90.0), 1e-6, 5.0, 6.0), 2U);
}

// A chord of angle a on a circle of radius r sags by r (1 - cos(a/2)): the tolerance is met, and with half as
// many it was not.
TEST(MotionKeys, a_turn_stays_within_the_tolerance) {
    const double radius = std::sqrt(2.0);
    for (const double degrees : {10.0, 90.0, 170.0})
        for (const double tolerance : {0.1, 0.01, 0.001}) {
            const uint32_t keys = motion_keys_for(turning_box(degrees), tolerance, 1.0, 2.0);
            const auto sag = [&](uint32_t n) {
                return radius * (1.0 - std::cos(0.5 * degrees * degree / (n - 1)));
            };
            std::printf("%3.0f degrees within %.3f m: %u keys, off by %.2g m\n", degrees, tolerance, keys,
                        sag(keys));
            EXPECT_LE(sag(keys), tolerance * 1.001);
            if (keys > 2) {
                EXPECT_GT(sag((keys + 1) / 2), tolerance);
            }
        }
    EXPECT_EQ(motion_keys_for(turning_box(170.0), 0.0, 1.0, 2.0), 64U);
}
