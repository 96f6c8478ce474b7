// SPDX-License-Identifier: Apache-2.0
// Stages without triangles: rotation, bend, jiggle, noise.
#include "tests/oracle/bend.h"
#include "tests/oracle/jiggle.h"
#include "tests/oracle/noise.h"
#include "tests/oracle/test_shapes.h"
#include "tests/oracle/turn.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

namespace marram::oracle {
namespace {

std::vector<Vec3d> upright(int segments, double length) {
    std::vector<Vec3d> cvs;
    for (int k = 0; k <= segments; ++k) cvs.push_back(y * (length * k / segments));
    return cvs;
}

TEST(OracleBend, AStraightStrandTurnsByWhatIsLeftAtEverySegment) {
    // The part beyond P_k is straight and at angle a_k to the wind; rotating it by f a_k leaves (1 - f) a_k.
    for (int segments : {1, 4, 64}) {
        const double length = 2.0, knots[] = {0.0, 0.1, 1.0, 0.6};
        Bend bend;
        bend.ramp_rotate = Ramp(knots, "linear");
        const std::vector<Vec3d> bent = bend_curve(upright(segments, length), bend);
        Vec3d expected = Vec3d::Zero();
        double from_wind = 0.5 * pi;
        for (int k = 0; k < segments; ++k) {
            from_wind *= 1.0 - (0.1 + 0.5 * k / segments);
            expected += length / segments * Vec3d(std::cos(from_wind), std::sin(from_wind), 0);
            EXPECT_NEAR((bent[size_t(k) + 1] - expected).norm(), 0.0, 1e-13);
        }
    }
}

TEST(OracleBend, WithReferenceSegmentsAnyNumberOfCvsTurnsAsFar) {
    for (int segments : {4, 8, 64}) {
        Bend bend;
        bend.global_rotate = 0.4;
        bend.reference_segments = 4.0;
        const std::vector<Vec3d> bent = bend_curve(upright(segments, 1.0), bend);
        const Vec3d last = (bent.back() - bent[size_t(segments) - 1]).normalized();
        // The last segment points as the bend does at its middle.
        const double turns = 4.0 * (1.0 - 0.5 / segments);
        EXPECT_NEAR(std::atan2(last.y(), last.x()), 0.5 * pi * std::pow(0.6, turns), 1e-12) << segments;
    }
}

TEST(OracleBend, FullWindLaysEverythingAlongItAndNoneLeavesEveryBit) {
    Draw draw(1);
    std::vector<Vec3d> rest{draw.in_cube()};
    for (int k = 0; k < 7; ++k) rest.push_back(rest.back() + 0.2 * draw.direction() + 0.1 * y);
    Bend bend;
    bend.wind = draw.direction();
    const std::vector<Vec3d> full = bend_curve(rest, bend);
    EXPECT_NEAR((full.back() - full[6]).normalized().dot(bend.wind), 1.0, 1e-12);
    for (size_t k = 0; k + 1 < rest.size(); ++k)
        EXPECT_NEAR((full[k + 1] - full[k]).norm(), (rest[k + 1] - rest[k]).norm(), 1e-14);
    bend.envelope.assign(8, 0.0);
    const std::vector<Vec3d> none = bend_curve(rest, bend);
    for (size_t k = 0; k < rest.size(); ++k) EXPECT_TRUE(none[k] == rest[k]);
}

TEST(OracleBend, RampEnvelopeAndNoiseEnterWhereTheChainSays) {
    const double knots[] = {0.0, 0.0, 1.0, 1.0};
    Bend bend;
    bend.ramp_rotate = Ramp(knots, "linear");
    bend.envelope = {1.0, 0.5, 1.0, 1.0, 1.0};
    bend.global_rotate = 2.0;
    const std::vector<double> f = bend_factors(upright(4, 3.0), bend);
    EXPECT_DOUBLE_EQ(f[0], 0.0);
    EXPECT_DOUBLE_EQ(f[1], 0.25);
    EXPECT_DOUBLE_EQ(f[2], 1.0);
    EXPECT_DOUBLE_EQ(f[3], 1.0) << "clamped";
    Bend noisy;
    noisy.noise = {z - x};
    const std::vector<Vec3d> bent = bend_curve({Vec3d::Zero(), y}, noisy);
    EXPECT_NEAR((bent[1] - z).norm(), 0.0, 1e-15) << "wind x and noise z - x together blow along z";
    noisy.noise = {-x};
    EXPECT_TRUE(bend_curve({Vec3d::Zero(), y}, noisy)[1] == y) << "noise cancels the wind";
}

TEST(OracleBend, WindAgainstTheStrandTurnsItByTheStatedAxes) {
    Bend bend;
    bend.wind = -y;
    bend.global_rotate = 0.5;
    // The tip is straight above the root, with a bow to +x: segment 0 rotates towards the tip, that is to -x.
    const std::vector<Vec3d> bow{{0, 0, 0}, {0.5, 1, 0}, {0, 2, 0}};
    const Turn turn = shortest_turn(bow[2], -y, bow[1], bow[2], x);
    EXPECT_NEAR((turn.axis - z).norm(), 0.0, 1e-15) << "(0.5, 1, 0) x (0, 2, 0) points along z";
    EXPECT_DOUBLE_EQ(turn.angle, pi);
    const Vec3d segment = turned(bow[1], turn.axis, 0.1);
    EXPECT_LT(segment.x(), bow[1].x());
    for (const Vec3d& p : bend_curve(bow, bend)) EXPECT_EQ(p.z(), 0.0) << "stays in its plane";
    // Straight strand: the direction of the noise decides, or the coordinate axis of its smallest component.
    EXPECT_NEAR((shortest_turn(y, -y, y, y, x).axis - y.cross(x)).norm(), 0.0, 1e-15);
    EXPECT_NEAR((shortest_turn(y, -y, y, y, 2 * y).axis - y.cross(x)).norm(), 0.0, 1e-15);
    EXPECT_EQ(shortest_turn(Vec3d::Zero(), y, y, y, x).angle, 0.0);
    const Turn near = shortest_turn(y, Vec3d(1e-9, -1, 0), y, y, z);
    EXPECT_NEAR((near.axis - y.cross(x)).norm(), 0.0, 1e-6) << "its own axis as long as there is one";
}

TEST(OracleBend, HardStrandsStayFinite) {
    for (double scale : {0.0, 1e-30, 1e30})
        for (double against : {1.0, -1.0}) {
            Bend bend;
            bend.wind = against * y;
            bend.reference_segments = 3.0;
            for (const std::vector<Vec3d>& rest : {upright(1, scale), upright(3, scale),
                                                   std::vector<Vec3d>{y * scale, y * scale, 2.0 * y * scale}})
                for (const Vec3d& p : bend_curve(rest, bend)) EXPECT_TRUE(p.allFinite());
        }
}

// Response of the oscillator, at rest at 0, to the target t from t = 0 on.
double ramp_response(double t, double omega, double zeta) {
    const double decay = std::exp(-zeta * omega * t);
    if (zeta == 1.0) return t - 2.0 / omega + decay * (2.0 / omega + t);
    const double w = omega * std::sqrt(std::abs(1.0 - zeta * zeta));
    const double even = zeta < 1.0 ? std::cos(w * t) : std::cosh(w * t);
    const double odd = zeta < 1.0 ? std::sin(w * t) : std::sinh(w * t);
    return t - 2.0 * zeta / omega + decay * (2.0 * zeta / omega * even + (2.0 * zeta * zeta - 1.0) / w * odd);
}

TEST(OracleJiggle, ATargetThatStartsToMoveIsFollowedByTheClosedForm) {
    double worst = 0.0;
    for (double zeta : {0.0, 0.05, 0.5, 1.0, 2.0, 5.0})
        for (double omega : {0.5, 2.0 * pi * 3.0, 60.0}) {
            // At rest, rising from t = 0.25 to 1.25, then constant: the difference of two ramps.
            const Vec3d slope(1.0, -2.0, 0.5);
            History history{{-1.0, 0.25, 0.5, 1.25, 2.0}, {}};
            for (double t : history.times) history.poses.push_back({slope * std::clamp(t - 0.25, 0.0, 1.0)});
            for (double t : {0.1, 0.3, 1.0, 1.25, 1.9, 3.0}) {
                double expected = t > 0.25 ? ramp_response(t - 0.25, omega, zeta) : 0.0;
                if (t > 1.25) expected -= ramp_response(t - 1.25, omega, zeta);
                const Vec3d found = filtered_pose(history, {omega}, zeta, t)[0];
                // sinh and cosh of the closed form cancel for zeta > 1, which costs some digits.
                worst = std::max(worst, (found - slope * expected).norm());
            }
        }
    std::printf("  off by %.1e\n", worst);
    EXPECT_LT(worst, 1e-11);
}

TEST(OracleJiggle, AConstantTargetStaysAndAnUndampedStrandSwingsForEver) {
    const std::vector<Vec3d> pose{{1, 2, 3}, {4, 5, 6}};
    const History still{{0.0, 1.0, 2.0}, {pose, pose, pose}};
    for (double zeta : {0.0, 1.0, 50.0}) {
        const std::vector<Vec3d> found = filtered_pose(still, {30.0, 10.0}, zeta, 1.7);
        for (size_t k = 0; k < 2; ++k) EXPECT_NEAR((found[k] - pose[k]).norm(), 0.0, 1e-13);
    }
    // A step within 1e-6 s, then energy is conserved: x = 1 - cos(omega t).
    const History step{{0.0, 1e-6}, {{Vec3d::Zero()}, {x}}};
    for (double t : {0.5, 10.0, 100.0})
        EXPECT_NEAR(filtered_pose(step, {7.0}, 0.0, t)[0].x(), 1.0 - std::cos(7.0 * (t - 0.5e-6)), 1e-10)
            << t;
}

TEST(OracleJiggle, LengthsAreRestoredFromTheTrueRoot) {
    const std::vector<Vec3d> bent{{1, 0, 0}, {1, 1, 0}, {1, 3, 0}};
    const std::vector<Vec3d> filtered{{0, 0, 0}, {1, 4, 0}, {1, 4, 0}};
    const std::vector<Vec3d> restored = restored_lengths(filtered, bent, {1.0, 2.0});
    EXPECT_NEAR((restored[0] - Vec3d(1, 0, 0)).norm(), 0.0, 0.0);
    EXPECT_NEAR((restored[1] - Vec3d(1, 1, 0)).norm(), 0.0, 1e-15) << "seen from the true root";
    EXPECT_NEAR((restored[2] - Vec3d(1, 3, 0)).norm(), 0.0, 1e-15) << "no direction left: the bent one";
    const History history{{0.0, 1.0}, {bent, {{2, 0, 0}, {2, 1, 0}, {2, 3, 0}}}};
    EXPECT_NEAR((pose_at(history, 0.25)[2] - Vec3d(1.25, 3, 0)).norm(), 0.0, 1e-15);
}

TEST(OracleNoise, ItVanishesOnTheLatticeAndHasAnEdgeOfTheCubeAsItsSlope) {
    Draw draw(3);
    for (int i = 0; i < 300; ++i) {
        const Vec3d corner(draw.below(2000) - 1000, draw.below(2000) - 1000, draw.below(2000) - 1000);
        EXPECT_EQ(perlin(corner, 7).norm(), 0.0);
        EXPECT_EQ(perlin(corner, 5.0, 7).norm(), 0.0);
        const double h = 1e-5; // error O(h^3)
        Eigen::Matrix3d slope;
        for (int axis = 0; axis < 3; ++axis)
            slope.col(axis) =
                (perlin(corner + h * Vec3d::Unit(axis), 7) - perlin(corner - h * Vec3d::Unit(axis), 7)) /
                (2.0 * h);
        for (int component = 0; component < 3; ++component) {
            EXPECT_NEAR(slope.row(component).squaredNorm(), 2.0, 1e-6);
            EXPECT_NEAR(slope.row(component).cwiseAbs().maxCoeff(), 1.0, 1e-6);
        }
    }
}

TEST(OracleNoise, GradientsAreTheEdgesOfACubeFourOfThemTwice) {
    // Perlin 2002 repeats (1,1,0), (-1,1,0), (0,-1,1), (0,-1,-1). 4000 corners with three components: 750 of
    // each edge, 1500 of the repeated ones.
    int seen[3][3][3] = {};
    const double h = 1e-4;
    for (int i = 0; i < 4000; ++i) {
        const Vec3d corner(i % 20, (i / 20) % 20, i / 400);
        Eigen::Matrix3d slope;
        for (int axis = 0; axis < 3; ++axis) slope.col(axis) = perlin(corner + h * Vec3d::Unit(axis), 5) / h;
        for (int component = 0; component < 3; ++component) {
            const Vec3d edge = slope.row(component).transpose().array().round();
            ++seen[int(edge.x()) + 1][int(edge.y()) + 1][int(edge.z()) + 1];
        }
    }
    const Vec3d twice[4] = {{1, 1, 0}, {-1, 1, 0}, {0, -1, 1}, {0, -1, -1}};
    for (int i = -1; i <= 1; ++i)
        for (int j = -1; j <= 1; ++j)
            for (int k = -1; k <= 1; ++k) {
                const Vec3d edge(i, j, k);
                double expected = edge.squaredNorm() == 2.0 ? 750.0 : 0.0;
                if (std::find(twice, twice + 4, edge) != twice + 4) expected = 1500.0;
                EXPECT_NEAR(seen[i + 1][j + 1][k + 1], expected, 5.0 * std::sqrt(expected))
                    << edge.transpose();
            }
}

TEST(OracleNoise, AlongALatticeLineTwoSlopesAreBlendedByTheQuintic) {
    for (int cell = -5; cell < 5; ++cell)
        for (double t : {0.1, 0.5, 0.8}) {
            const Vec3d value = perlin({cell + t, 3, -2}, 1);
            const double f = t * t * t * (6 * t * t - 15 * t + 10);
            for (int component = 0; component < 3; ++component) {
                double nearest = 1.0;
                for (int a = -1; a <= 1; ++a)
                    for (int b = -1; b <= 1; ++b)
                        nearest = std::min(nearest,
                                           std::abs(value[component] - ((1 - f) * a * t + f * b * (t - 1))));
                EXPECT_LT(nearest, 1e-13);
            }
        }
}

TEST(OracleNoise, ItRepeatsAfterThePeriodAndOctavesAddUp) {
    const Vec3d p(0.3, 0.6, 0.2), period(0x1p32, -0x1p32, 0x1p33);
    const Vec3d exact(0.25, 0.625, 0.125); // still exact after adding the period
    EXPECT_EQ((perlin(exact, 3) - perlin(exact + period, 3)).norm(), 0.0);
    EXPECT_EQ((perlin(exact, 0.5, 3) - perlin(exact, 0.5 + 0x1p32, 3)).norm(), 0.0);
    Fractal noise{2.0, 3, 1.5, 0.25, 9};
    const Vec3d sum = perlin(2.0 * p, 9) + 0.25 * perlin(3.0 * p, 9 + 0x6d2b79f5U) +
                      0.0625 * perlin(4.5 * p, 9 + 2 * 0x6d2b79f5U);
    EXPECT_NEAR((fractal_noise(noise, p) - sum / std::sqrt(1.0 + 0.0625 + 0.00390625)).norm(), 0.0, 1e-14);
    noise.octaves = 1;
    EXPECT_NEAR((fractal_noise(noise, p, 0.7) - perlin(2.0 * p, 0.7, 9)).norm(), 0.0, 1e-15);
}

TEST(OracleNoise, ItHasNoMeanAndNoPreferredComponent) {
    for (uint64_t seed : {1, 2, 3}) {
        Draw draw(seed);
        Vec3d mean = Vec3d::Zero(), square = Vec3d::Zero();
        const int count = 40000;
        for (int i = 0; i < count; ++i) {
            const Vec3d v = perlin(1000.0 * draw.in_cube(), uint32_t(seed));
            mean += v / count;
            square += v.cwiseAbs2() / count;
        }
        std::printf("  seed %d: mean %.1e, rms %.4f %.4f %.4f\n", int(seed), mean.norm(),
                    std::sqrt(square.x()), std::sqrt(square.y()), std::sqrt(square.z()));
        EXPECT_LT(mean.norm(), 0.01); // 5 standard errors of 0.28 / 200
        EXPECT_LT(square.maxCoeff() / square.minCoeff(), 1.06);
    }
}

} // namespace
} // namespace marram::oracle
