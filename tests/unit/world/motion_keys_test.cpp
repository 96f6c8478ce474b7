// SPDX-License-Identifier: Apache-2.0
// The tolerance chooses the number of motion keys.
#include "core/geometry/motion_keys.h"

#include <gtest/gtest.h>

#include <cstdio>

using namespace marram;

namespace {

// A box of 2 m that rotates by `degrees` about y from frame 1 to 2 and moves by 3 m.
SceneMesh turning_box(double degrees) {
    SceneMesh mesh;
    mesh.name = "box";
    mesh.mesh = box_mesh(Vec3f(2.0F, 2.0F, 2.0F));
    mesh.transform = KeyedTransform(
        std::vector<double>{1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 2, 3, 0, 0, 0, degrees, 0, 1, 1, 1}, "linear");
    return mesh;
}

} // namespace

TEST(MotionKeys, TwoAreEnoughForAStraightLine) {
    EXPECT_EQ(motion_keys_for(turning_box(0.0), 1e-6, View{}, 1.0, 2.0), 2U);
    EXPECT_EQ(motion_keys_for(SceneMesh{}, 1e-6, View{}, 1.0, 2.0), 2U);
}

TEST(MotionKeys, NothingMovesWhileTheShutterIsClosedOrTheShotIsOver) {
    EXPECT_EQ(motion_keys_for(turning_box(90.0), 1e-6, View{}, 1.5, 1.5), 2U);
    EXPECT_EQ(motion_keys_for(turning_box(90.0), 1e-6, View{}, 5.0, 6.0), 2U);
}

// A chord of angle a on a circle of radius r has the sagitta r (1 - cos(a/2)): the chosen keys meet the
// tolerance, half as many do not.
TEST(MotionKeys, ATurnStaysWithinTheTolerance) {
    const double radius = std::sqrt(2.0);
    for (const double degrees : {10.0, 90.0, 170.0})
        for (const double tolerance : {0.1, 0.01, 0.001}) {
            const uint32_t keys = motion_keys_for(turning_box(degrees), tolerance, View{}, 1.0, 2.0);
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
    EXPECT_EQ(motion_keys_for(turning_box(170.0), 0.0, View{}, 1.0, 2.0), 64U);
}

// Whole turns between keys must not be taken for rest.
TEST(MotionKeys, WholeTurnsAreSeen) {
    for (const double turns : {1.0, 2.0, 3.0, 4.0, 4.003, 8.0, 12.0, 16.0}) {
        const SceneMesh box = turning_box(360.0 * turns);
        EXPECT_EQ(motion_keys_for(box, 1e-4, View{}, 1.0, 2.0), 64U) << turns;
        EXPECT_GT(motion_error(box, View{}, 2, 1.0, 2.0), 0.1) << turns;
    }
}

namespace {

// A box that moves along x, with (frame, x) keys.
SceneMesh box_along(const std::vector<std::pair<double, double>>& ways) {
    SceneMesh mesh = turning_box(0.0);
    std::vector<double> keys;
    for (const auto& [frame, x] : ways) keys.insert(keys.end(), {frame, x, 0, 0, 0, 0, 0, 1, 1, 1});
    mesh.transform = KeyedTransform(keys, "linear");
    return mesh;
}

} // namespace

// A kink in the path needs a motion key at its time: frame 10 is at 1/2 of one shutter, at 0.24 / 0.49 of
// another.
TEST(MotionKeys, ABendAsksForAKeyWhereItIs) {
    const SceneMesh box = box_along({{9, 0}, {10, 1}, {11, 1}});
    EXPECT_EQ(motion_keys_for(box, 1e-6, View{}, 9.75, 10.25), 3U);
    EXPECT_EQ(motion_keys_for(box, 1e-6, View{}, 9.8, 10.3), 6U);
    EXPECT_EQ(motion_keys_for(box, 1e-6, View{}, 9.8, 10.3, 7), 11U) << "more keys need not be better";
    EXPECT_GT(motion_error(box, View{}, 8, 9.8, 10.3), 0.01);
    const uint32_t keys = motion_keys_for(box, 1e-3, View{}, 9.76, 10.25);
    EXPECT_LE(motion_error(box, View{}, keys, 9.76, 10.25), 1e-3) << keys;
    EXPECT_LT(keys, 64U);
}

TEST(MotionKeys, WhatComesAndGoesWithinTheShutterIsSeen) {
    const SceneMesh box = box_along({{10, 0}, {10.04, 1.6}, {10.08, 0}});
    EXPECT_NEAR(motion_error(box, View{}, 2, 10.0, 11.0), 1.6, 1e-6);
    EXPECT_GE(motion_keys_for(box, 1e-3, View{}, 10.0, 11.0), 26U);
}

TEST(MotionKeys, EqualKeysAreRest) {
    const KeyedTransform rest(
        std::vector<double>{1, 0, 2, 0, 0, 30, 0, 1, 1, 1, 2, 0, 2, 0, 0, 30, 0, 1, 1, 1}, "linear"),
        turn(std::vector<double>{1, 0, 2, 0, 0, 0, 0, 1, 1, 1, 2, 0, 2, 0, 0, 360, 0, 1, 1, 1}, "linear");
    EXPECT_FALSE(rest.moves() || rest.moves_within(1.0, 2.0));
    EXPECT_TRUE(turn.moves() && turn.moves_within(1.0, 2.0));
}

namespace {

// From z = 10 along -z, 90 degrees wide; a tolerance in pixels has its size in metres at z = 0.
View looking() {
    return {.position = {0.0, 0.0, 10.0},
            .cosine = std::cos(45.0 * degree),
            .pixel_angle = 1e-3,
            .reference_depth = 10.0};
}

} // namespace

TEST(MotionKeys, PixelsAreLargerNearer) {
    const View view = looking();
    EXPECT_EQ(View{}.enlarged({1.0, 2.0, 3.0}), 1.0) << "metres";
    EXPECT_DOUBLE_EQ(view.enlarged({0.0, 0.0, 0.0}), 1.0);
    EXPECT_DOUBLE_EQ(view.enlarged({4.0, -2.0, 0.0}), 1.0) << "beside the target it is as large";
    EXPECT_DOUBLE_EQ(view.enlarged({0.0, 0.0, 8.0}), 5.0);
    EXPECT_DOUBLE_EQ(view.enlarged({0.0, 0.0, -30.0}), 0.25);
    EXPECT_DOUBLE_EQ(view.enlarged({5.0, 0.0, 8.0}), 1.0) << "out of view";
    EXPECT_DOUBLE_EQ(view.enlarged({0.0, 0.0, 12.0}), 1.0) << "behind";
    EXPECT_DOUBLE_EQ(view.enlarged({0.0, 0.0, 30.0}), 0.5) << "far behind";
    EXPECT_DOUBLE_EQ(view.enlarged(view.position), 1.0);

    // The largest scale in the shutter counts, for a camera that comes closer and for one that turns towards
    // a point.
    View moving = looking();
    moving.later.emplace_back(Vec3d(0.0, 0.0, 2.0), Vec3d(1.0, 0.0, 0.0));
    EXPECT_DOUBLE_EQ(moving.enlarged({0.0, 0.0, 5.0}), 2.0);
    EXPECT_DOUBLE_EQ(moving.enlarged({1.0, 0.0, 2.0}), 10.0);

    // At a quarter of the distance: twice as many keys, less one.
    const SceneMesh box = turning_box(90.0);
    const auto keys_from = [&](double z) {
        View from = looking();
        from.position.z() = z;
        return motion_keys_for(box, 0.01, from, 1.0, 2.0);
    };
    EXPECT_EQ(keys_from(1e3), 2U) << "a speck";
    EXPECT_GE(keys_from(3.5), keys_from(10.0) * 3 / 2);
    EXPECT_LE(motion_error(box, looking(), motion_keys_for(box, 0.01, looking(), 1.0, 2.0), 1.0, 2.0), 0.01);
}

namespace {

// Adds one CV at five instants of a unit of time.
template <typename Path>
void add(StrandMotion& motion, Path&& path, size_t instants, const View& view);
template <typename Path>
void add(StrandMotion& motion, Path&& path, const View& view = {}) {
    add(motion, path, 5, view);
}
template <typename Path>
void add(StrandMotion& motion, Path&& path, size_t instants, const View& view) {
    std::vector<std::array<float, 4>> at(instants);
    std::vector<const float*> samples(instants);
    for (size_t i = 0; i < instants; ++i) {
        const Vec3d p = path(double(i) / double(instants - 1));
        for (int axis = 0; axis < 3; ++axis) at[i][axis] = float(p[axis]);
        at[i][3] = 0.1F;
        samples[i] = at[i].data();
    }
    motion.add(samples, 1, view);
}

// The largest error of linear interpolation of a path between that many keys, sampled at many instants.
template <typename Path>
double sag(Path&& path, uint32_t keys) {
    double worst = 0.0;
    const int fine = 1000;
    for (int i = 0; i <= fine; ++i) {
        const double t = double(i) / fine, last = double(keys - 1);
        const double key = std::min(std::floor(t * last), last - 1.0), s = t * last - key;
        const Vec3d line = (1.0 - s) * path(key / last) + s * path((key + 1.0) / last);
        worst = std::max(worst, (path(t) - line).norm());
    }
    return worst;
}

} // namespace

TEST(StrandMotion, KeysHoldAStrandToTheTolerance) {
    for (const double turn : {0.0, 0.3, 1.5, 3.0})
        for (const double tolerance : {0.03, 0.003, 0.0003}) {
            const auto path = [turn](double t) {
                return Vec3d(2.0 * t + 0.4 * std::sin(turn * t), 0.4 * std::cos(turn * t), 0.05 * t * t);
            };
            StrandMotion motion;
            for (int i = 0; i < 100; ++i) add(motion, path);
            const uint32_t keys = motion.keys_for(tolerance);
            EXPECT_LE(sag(path, keys), tolerance) << turn << " in " << tolerance << ": " << keys << " keys";
            if (keys > 2) {
                // The margin is tight: three quarters of the keys are not enough.
                EXPECT_GT(sag(path, std::max(2U, keys * 3 / 4)), 0.9 * tolerance) << turn << ", " << keys;
            }
            EXPECT_EQ(motion.jump_fraction(tolerance), 0.0);
        }
    EXPECT_EQ(StrandMotion{}.keys_for(0.0), 2U);
}

TEST(StrandMotion, AToleranceInPixelsIsOfEachStrandsOwnDistance) {
    const auto keys_at = [](const Vec3d& place) {
        StrandMotion motion;
        add(
            motion,
            [&](double t) {
                return Vec3d(place + Vec3d(0.1 * std::sin(2.0 * t), 0.1 * std::cos(2.0 * t), 0.0));
            },
            looking());
        return motion.keys_for(1e-3);
    };
    StrandMotion metres;
    add(metres, [](double t) { return Vec3d(0.1 * std::sin(2.0 * t), 0.1 * std::cos(2.0 * t), 0.0); });
    const uint32_t keys = metres.keys_for(1e-3);
    EXPECT_EQ(keys_at({0.0, 0.0, 0.0}), keys);
    EXPECT_EQ(keys_at({0.0, 0.0, 15.0}), keys) << "behind the camera";
    EXPECT_NEAR(double(keys_at({0.0, 0.0, 7.5})) - 1.0, 2.0 * (keys - 1.0), 1.0) << "four times as near";
    EXPECT_NEAR(double(keys_at({0.0, 0.0, -30.0})) - 1.0, 0.5 * (keys - 1.0), 1.0) << "four times as far";
}

// With five instants, a strand that turns by more than a right angle between two of them counts as jumping.
TEST(StrandMotion, WhatTurnsFastIsLookedAtMoreOften) {
    const auto turn = [](double t) { return Vec3d(std::cos(3.0 * pi * t), std::sin(3.0 * pi * t), 0.0); };
    StrandMotion few, more;
    add(few, turn);
    add(more, turn, 17, View{});
    EXPECT_EQ(few.jump_fraction(0.01), 1.0);
    EXPECT_EQ(more.jump_fraction(0.01), 0.0);
    const uint32_t keys = more.keys_for(0.01);
    EXPECT_LE(sag(turn, keys), 0.01) << keys;
    EXPECT_GT(sag(turn, keys * 3 / 4), 0.009) << keys;
    StrandMotion jumps;
    add(
        jumps, [](double t) { return Vec3d(t < 0.6 ? 0.0 : 0.1, 0.0, 0.0); }, 17, View{});
    EXPECT_EQ(jumps.jump_fraction(0.01), 1.0);
    EXPECT_EQ(jumps.keys_for(0.01), 2U);
}

TEST(StrandMotion, WhatJumpsAndWhatIsRareAsksForNothing) {
    const auto still = [](double) { return Vec3d(1.0, 2.0, 3.0); };
    const auto jump = [](double t) { return Vec3d(t < 0.6 ? 0.0 : 0.1, 0.0, 0.0); };
    const auto whip = [](double t) { return Vec3d(std::cos(2.0 * t), std::sin(2.0 * t), 0.0); };
    StrandMotion motion;
    for (int i = 0; i < 50; ++i) add(motion, still);
    for (int i = 0; i < 50; ++i) add(motion, jump);
    EXPECT_EQ(motion.keys_for(0.001), 2U);
    EXPECT_EQ(motion.jump_fraction(0.001), 0.5);
    EXPECT_EQ(motion.jump_fraction(1.0), 0.0) << "too small to matter";
    for (const int n : {2, 3, 50, 99}) { // of a few strands each counts
        StrandMotion few;
        for (int i = 0; i + 1 < n; ++i) add(few, still);
        add(few, whip);
        EXPECT_GT(few.keys_for(0.001), 10U) << n;
    }
    StrandMotion more;
    for (int i = 0; i < 1000; ++i) add(more, still);
    for (int i = 0; i < 5; ++i) add(more, whip);
    EXPECT_EQ(more.keys_for(0.001), 2U) << "one in two hundred";
    for (int i = 0; i < 10; ++i) add(more, whip);
    EXPECT_GT(more.keys_for(0.001), 10U) << "one in seventy";
}
