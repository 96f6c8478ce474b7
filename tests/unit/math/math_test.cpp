// SPDX-License-Identifier: Apache-2.0
#include "core/math/hash.h"
#include "core/math/problem.h"
#include "core/math/ramp.h"
#include "core/math/rotation.h"
#include "core/math/transform.h"

#include <gtest/gtest.h>

#include <bit>

using namespace marram;

TEST(Ramp, KnotsEndsAndInterpolation) {
    const std::vector<double> knots = {0.0, 1.0, 1.0, 3.0, 2.0, -1.0};
    const Ramp linear(knots, "linear"), smooth(knots, "smooth"), constant(knots, "constant");
    for (const Ramp* ramp : {&linear, &smooth, &constant}) {
        EXPECT_EQ((*ramp)(-5.0), 1.0);
        EXPECT_EQ((*ramp)(0.0), 1.0);
        EXPECT_EQ((*ramp)(1.0), 3.0);
        EXPECT_EQ((*ramp)(2.0), -1.0);
        EXPECT_EQ((*ramp)(99.0), -1.0);
    }
    EXPECT_DOUBLE_EQ(linear(0.25), 1.5);
    EXPECT_DOUBLE_EQ(smooth(0.5), 2.0);
    EXPECT_NEAR((smooth(1e-6) - smooth(0.0)) / 1e-6, 0.0, 1e-5); // flat at a knot
    EXPECT_EQ(constant(0.999), 1.0);
    EXPECT_EQ(Ramp()(0.3), 1.0);
}

TEST(KeyedTransform, IsExactAtKeysAndConstantOutside) {
    const std::vector<double> keys = {1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 5, 4, 8, 0, 0, 90, 0, 2, 2, 2};
    for (const char* interpolation : {"linear", "smooth"}) {
        const KeyedTransform keyed(keys, interpolation);
        EXPECT_TRUE(keyed.at(1.0).isApprox(Eigen::Affine3d::Identity()));
        EXPECT_TRUE(keyed.at(-100.0).isApprox(keyed.at(1.0)));
        EXPECT_TRUE(keyed.at(1e9).isApprox(keyed.at(5.0)));
        // 90 degrees about y takes x to -z; scaled by 2, moved by (4, 8, 0).
        EXPECT_LT((keyed.at(5.0) * Vec3d(1, 0, 0) - Vec3d(4, 8, -2)).norm(), 1e-12);
        const Eigen::Affine3d middle = keyed.at(3.0);
        EXPECT_LT((middle.translation() - Vec3d(2, 4, 0)).norm(), 1e-12);
        EXPECT_NEAR(std::cbrt(middle.linear().determinant()), 1.5, 1e-12);
    }
    EXPECT_NEAR(KeyedTransform(keys, "linear").at(2.0).translation().x(), 1.0, 1e-12);
    EXPECT_NEAR(KeyedTransform(keys, "smooth").at(2.0).translation().x(), 4.0 * (3.0 / 16.0 - 2.0 / 64.0),
                1e-12);
}

TEST(KeyedTransform, EulerAnglesTurnAboutXThenYThenZ) {
    const std::vector<double> keys = {0, 0, 0, 0, 90, 0, 90, 1, 1, 1};
    // About x, y turns to z; about z, z stays.
    EXPECT_LT((KeyedTransform(keys, "linear").at(0.0) * Vec3d(0, 1, 0) - Vec3d(0, 0, 1)).norm(), 1e-12);
}

// A wheel: two turns in 24 frames, also backwards. No turn is lost if neighbouring keys are half a turn or
// more apart.
TEST(KeyedTransform, TurnsAsFarAsItsKeysSay) {
    for (const double turns : {0.5, 1.0, 2.0, -2.0}) {
        const KeyedTransform wheel(
            std::vector<double>{0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 24, 0, 0, 0, 0, 0, 360.0 * turns, 1, 1, 1},
            "linear");
        for (const double frame : {1.0, 5.0, 13.5, 23.0}) {
            const double angle = 2.0 * 3.14159265358979323846 * turns * frame / 24.0;
            EXPECT_LT((wheel.at(frame) * Vec3d(1, 0, 0) - Vec3d(std::cos(angle), std::sin(angle), 0)).norm(),
                      1e-12)
                << turns << " turns, frame " << frame;
        }
    }
}

TEST(KeyedTransform, KnowsWhenItMoves) {
    EXPECT_FALSE(KeyedTransform().moves());
    const KeyedTransform keyed(
        std::vector<double>{1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 5, 4, 8, 0, 0, 90, 0, 2, 2, 2}, "linear");
    EXPECT_TRUE(keyed.moves_within(0.0, 2.0));
    EXPECT_TRUE(keyed.moves_within(4.9, 8.0));
    EXPECT_FALSE(keyed.moves_within(5.0, 8.0));
    EXPECT_FALSE(keyed.moves_within(3.0, 3.0));
}

TEST(Hash, UniformInEveryBitAndNeverOne) {
    constexpr int count = 100'000;
    int ones[64] = {};
    double sum = 0.0;
    for (uint64_t i = 0; i < count; ++i) {
        const uint64_t h = hash(7, i);
        for (int bit = 0; bit < 64; ++bit) ones[bit] += int((h >> bit) & 1U);
        sum += unit_double(h);
    }
    for (const int n : ones) EXPECT_NEAR(double(n) / count, 0.5, 0.01);
    EXPECT_NEAR(sum / count, 0.5, 0.005);
    EXPECT_LT(unit_double(UINT64_MAX), 1.0);
    EXPECT_LT(unit_float(UINT32_MAX), 1.0F);
}

TEST(Hash, AChangedBitChangesHalfOfThem) {
    double changed = 0.0;
    int pairs = 0;
    for (uint64_t i = 0; i < 500; ++i)
        for (int bit = 0; bit < 64; ++bit, ++pairs)
            changed += std::popcount(hash(3, i) ^ hash(3, i ^ (uint64_t(1) << bit)));
    EXPECT_NEAR(changed / pairs, 32.0, 0.5);
}

TEST(OrthonormalBasis, HoldsInEveryDirection) {
    for (const Vec3d& n : {Vec3d(0, 0, 1), Vec3d(0, 0, -1), Vec3d(1, 0, 0), Vec3d(0, -1, 0),
                           Vec3d(1e-9, 0, -1).normalized(), Vec3d(1, 2, 3).normalized()}) {
        Vec3d t, b;
        orthonormal_basis<double>(n, t, b);
        EXPECT_NEAR(t.norm(), 1.0, 1e-12);
        EXPECT_NEAR(t.dot(n), 0.0, 1e-12);
        EXPECT_LT((n.cross(t) - b).norm(), 1e-12);
    }
}

// The bounds that rotation.h states, at angles that come ever closer to half a turn.
TEST(ShortestRotation, TurnsOneDirectionToAnotherWithinItsErrors) {
    constexpr double e = 0x1p-52;
    std::vector<double> gaps = {0.0, pi, pi - 1e-9}; // to half a turn
    for (double gap = 1.0; gap > 1e-18; gap *= 0.4) gaps.push_back(gap);
    for (uint64_t i = 0; i < 200; ++i) {
        const auto random = [&](uint64_t k) { return 2.0 * unit_double(hash(i, k)) - 1.0; };
        const Vec3d from = Vec3d(random(1), random(2), random(3)).normalized();
        const Vec3d side = from.cross(Vec3d(random(4), random(5), random(6))).normalized();
        for (const double gap : gaps) {
            SCOPED_TRACE(gap);
            const Vec3d to = std::sin(gap) * side - std::cos(gap) * from;
            const double d = 2.0 * std::pow(std::sin(0.5 * gap), 2.0); // 1 + cos(angle)
            const Eigen::Quaterniond q = shortest_rotation(1e-7 * from, 1e5 * to);
            EXPECT_NEAR(q.norm(), 1.0, std::min(5e-4, 4.0 * e / d) + 4.0 * e);
            EXPECT_LT((q.normalized() * from - to).norm(),
                      std::min(std::sqrt(8.0 * e), 8.0 * e / std::sqrt(d)) + 8.0 * e);
        }
    }
}

TEST(Problem, IsOneLine) {
    EXPECT_EQ(to_string(Problem{{"a.toml", 3, 7}, "what\nis wrong", "fix it"}),
              "a.toml:3:7: what is wrong: fix it");
    EXPECT_EQ(to_string(Problem{{"a.ply"}, "w", "f"}), "a.ply: w: f");
}
