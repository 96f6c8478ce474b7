// SPDX-License-Identifier: Apache-2.0
// The elastica in wind against closed forms, published figures, its differential equations and its energy.
#include "tests/oracle/elastica.h"
#include "tests/oracle/test_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

namespace marram::oracle {
namespace {

const double g = 9.81;

// Length 1, rigidity 1, straight, without taper: drag is Ca in wind of 1 m/s, and mass g is -B.
Blade straight_blade(const Vec3d& direction, int segments, double cauchy, double buoyancy) {
    Blade blade;
    for (int k = 0; k <= segments; ++k) blade.rest.push_back(direction * (double(k) / segments));
    blade.rigidity.assign(blade.rest.size(), 1.0);
    blade.drag.assign(blade.rest.size(), cauchy);
    blade.mass.assign(blade.rest.size(), -buoyancy / g);
    blade.wind = x;
    return blade;
}

// Length 1 and rigidity 1 at the root, with a random rest shape, taper, wind and weight.
Blade random_blade(Draw& draw, double max_cauchy, double max_buoyancy) {
    Blade blade;
    const int n = 4 + draw.below(12);
    Vec3d t = draw.direction(), axis = draw.direction(), at = Vec3d::Zero();
    const double turn = draw.unit() < 0.2 ? 0.0 : draw.unit() * 4.0 / n;
    for (int k = 0; k <= n; ++k) {
        blade.rest.push_back(at);
        at += t / n;
        axis = (axis + 0.5 * draw.in_cube()).normalized();
        t = (Eigen::AngleAxisd(turn, axis) * t).normalized();
    }
    const double cauchy = 0.1 * std::pow(10.0 * max_cauchy, draw.unit());
    const double buoyancy = max_buoyancy * draw.signed_unit(), tip = 0.2 + 0.8 * draw.unit();
    for (int k = 0; k <= n; ++k) {
        const double width = 1.0 + (tip - 1.0) * k / n;
        blade.rigidity.push_back(width * width * width);
        blade.drag.push_back(cauchy * width);
        blade.mass.push_back(-buoyancy * width / g);
        blade.wind_scale.push_back(0.7 + 0.3 * k / n);
    }
    blade.wind = draw.direction();
    return blade;
}

Vec3d tip_tangent(const Pose& pose) {
    const size_t n = pose.tangents.size();
    return (1.5 * pose.tangents[n - 1] - 0.5 * pose.tangents[n - 2]).normalized();
}

double max_distance(const std::vector<Vec3d>& a, const std::vector<Vec3d>& b) {
    double distance = 0.0;
    for (size_t k = 0; k < a.size(); ++k) distance = std::max(distance, (a[k] - b[k]).norm());
    return distance;
}

TEST(OracleElastica, WithoutLoadsThePoseIsTheRestShape) {
    Draw draw(1);
    for (int i = 0; i < 20; ++i) {
        Blade blade = random_blade(draw, 1.0, 0.0);
        blade.wind.setZero();
        const Pose pose = elastica(blade, 4);
        EXPECT_TRUE(pose.converged && !pose.snapped && !pose.buckled);
        EXPECT_LT(max_distance(pose.points, blade.rest), 1e-14);
    }
}

TEST(OracleElastica, ASmallUniformLoadBendsByTheLinearCantilever) {
    // Tip deflection q L^4 / (8 EI), here in other units than the dimensionless ones.
    const double length = 0.3, rigidity = 2e-5, mass = 1e-6;
    for (const Vec3d& side : {x, z, Vec3d((x - z).normalized())}) {
        Blade blade = straight_blade(length * side, 4, 0.0, 0.0);
        blade.rigidity.assign(5, rigidity);
        blade.mass.assign(5, mass);
        const Pose pose = elastica(blade, 64);
        const double expected = mass * g * std::pow(length, 4) / (8.0 * rigidity);
        EXPECT_NEAR(pose.points.back().y() / -expected, 1.0, 1e-4);
        EXPECT_NEAR(pose.moments[0].norm() / (0.5 * mass * g * length * length), 1.0, 1e-4);
        EXPECT_NEAR(pose.forces[0].norm() / (mass * g * length), 1.0, 1e-12);
    }
}

TEST(OracleElastica, ATipLoadBendsByTheEllipticIntegrals) {
    // Bisshopp and Drucker, Quarterly of Applied Mathematics 3 (1945); digits from Mattiasson, Int. J. Numer.
    // Methods Eng. 17 (1981). The load is the weight of a last segment of length 1e-5.
    const double cases[][3] = {// P L^2 / EI, vertical and horizontal displacement of the tip in L
                               {1.0, 0.30172, 0.05643},
                               {2.0, 0.49346, 0.16064},
                               {5.0, 0.71379, 0.38763},
                               {10.0, 0.81061, 0.55500}};
    const double short_length = 1e-5;
    for (const auto& [load, vertical, horizontal] : cases) {
        Blade blade;
        blade.rest = {Vec3d::Zero(), x * (1.0 - short_length), x};
        blade.rigidity = {1.0, 1.0, 1.0};
        blade.drag = {0.0, 0.0, 0.0};
        blade.mass = {0.0, 0.0, 2.0 * load / (g * short_length)};
        const Pose pose = elastica(blade, 400);
        EXPECT_TRUE(pose.converged);
        EXPECT_NEAR(-pose.points.back().y(), vertical, 3e-5) << load;
        EXPECT_NEAR(1.0 - pose.points.back().x(), horizontal, 3e-5) << load;
    }
}

TEST(OracleElastica, AHeavyColumnBucklesAtGreenhillsHeight) {
    const double critical = 7.8373; // Greenhill 1881: m g L^3 / EI
    EXPECT_TRUE(elastica(straight_blade(y, 4, 0.0, -0.999 * critical), 32).converged);
    // Beyond it the column may fall to any side.
    const Pose column = elastica(straight_blade(y, 4, 0.0, -10.0), 32);
    EXPECT_FALSE(column.converged);
    EXPECT_NEAR(column.load_factor * 10.0 / critical, 1.0, 1e-3);
    // The slightest wind decides.
    const Pose fallen = elastica(straight_blade(y, 4, 1e-4, -10.0), 32);
    EXPECT_TRUE(fallen.converged && !fallen.snapped);
    EXPECT_GT(fallen.points.back().x(), 0.5);
}

TEST(OracleElastica, AnUprightBladeMatchesLuharAndNepf) {
    // Luhar and Nepf, Limnol. Oceanogr. 56 (2011). Angle of the tip's tangent to the vertical. Effective
    // length: the drag along the wind over that of a rigid blade, = integral of cos^3 of that angle.
    const double cases[][2] = {{1.0, 9.31}, {10.0, 47.09}, {100.0, 76.71}, {1000.0, 87.20}, {10000.0, 89.57}};
    double last_drag = 0.0;
    for (const auto& [cauchy, angle] : cases) {
        const Pose pose = elastica(straight_blade(y, 8, cauchy, 0.0), 64);
        ASSERT_TRUE(pose.converged && !pose.snapped);
        const Vec3d tip = tip_tangent(pose);
        EXPECT_NEAR(std::atan2(tip.x(), tip.y()) / degree, angle, 0.01) << cauchy;
        const double effective = pose.forces[0].x() / cauchy;
        const double fit =
            1.0 - (1.0 - 0.9 * std::pow(cauchy, -1.0 / 3.0)) / (1.0 + 8.0 * std::pow(cauchy, -1.5));
        EXPECT_NEAR(effective / fit, 1.0, 0.05) << cauchy;
        double cubes = 0.0;
        for (const Vec3d& t : pose.tangents) cubes += std::pow(t.y(), 3) / double(pose.tangents.size());
        EXPECT_NEAR(effective, cubes, 1e-9);
        // Drag grows with a power of speed, speed^2 being Ca.
        const double exponent = 2.0 * std::log(pose.forces[0].x() / last_drag) / std::log(10.0);
        if (cauchy > 100.0) {
            EXPECT_NEAR(exponent, 4.0 / 3.0, 0.02);
        }
        last_drag = pose.forces[0].x();
    }
}

// The differential equations of elastica.h, integrated from the root.
struct Section {
    Vec3d r, m, f;
    Eigen::Matrix3d frame;
};
Section moved(const Section& s, const Section& rate, double h) {
    return {s.r + h * rate.r, s.m + h * rate.m, s.f + h * rate.f, s.frame + h * rate.frame};
}
Section rate_at(const Blade& blade, size_t segment, double u, const Section& s) {
    auto at = [&](const std::vector<double>& p) { return (1.0 - u) * p[segment] + u * p[segment + 1]; };
    const Vec3d t = s.frame.col(2), wind = at(blade.wind_scale) * blade.wind, across = wind - wind.dot(t) * t;
    const Vec3d load = at(blade.drag) * across.norm() * across + at(blade.mass) * blade.gravity;
    const Vec3d curvature = (s.m - s.m.dot(t) * t) / at(blade.rigidity);
    Eigen::Matrix3d turning;
    for (int c = 0; c < 3; ++c) turning.col(c) = curvature.cross(s.frame.col(c));
    return {t, -t.cross(s.f), -load, turning};
}

TEST(OracleElastica, ThePoseSolvesTheDifferentialEquations) {
    // Runge and Kutta's method from the root, with the clamp's force and moment, must end without either.
    Draw draw(2);
    for (int i = 0; i < 20; ++i) {
        const Blade blade = random_blade(draw, 30.0, 10.0);
        double error[2];
        for (int refinement : {0, 1}) {
            const Pose pose = elastica(blade, 16 << refinement);
            ASSERT_TRUE(pose.converged);
            Section s{blade.rest[0], pose.moments[0], pose.forces[0], {}};
            Vec3d t = (blade.rest[1] - blade.rest[0]).normalized();
            s.frame << t.unitOrthogonal(), t.cross(t.unitOrthogonal()), t;
            Eigen::Matrix3d rest_frame = s.frame;
            for (size_t k = 0; k + 1 < blade.rest.size(); ++k) {
                const Vec3d span = blade.rest[k + 1] - blade.rest[k], next = span.normalized();
                const Vec3d axis = t.cross(next);
                const Eigen::Matrix3d before = rest_frame;
                if (axis.norm() > 1e-9)
                    rest_frame = Eigen::AngleAxisd(std::asin(axis.norm()), axis.normalized()) * rest_frame;
                s.frame = s.frame * before.transpose() * rest_frame;
                t = next;
                const int steps = 64;
                const double h = span.norm() / steps, du = 1.0 / steps;
                for (int j = 0; j < steps; ++j) {
                    const double u = j * du;
                    const Section a = rate_at(blade, k, u, s);
                    const Section b = rate_at(blade, k, u + 0.5 * du, moved(s, a, 0.5 * h));
                    const Section c = rate_at(blade, k, u + 0.5 * du, moved(s, b, 0.5 * h));
                    const Section d = rate_at(blade, k, u + du, moved(s, c, h));
                    s = moved(moved(moved(moved(s, a, h / 6), b, h / 3), c, h / 3), d, h / 6);
                }
            }
            error[refinement] = (s.r - pose.points.back()).norm() + s.m.norm() + s.f.norm();
        }
        EXPECT_LT(error[1], 0.05) << i; // root moments are up to 10; errors grow towards the tip
        EXPECT_NEAR(error[0] / error[1], 4.0, 0.4) << i << ": " << error[1];
    }
}

// Bending energy of tangents against rest tangents, turns in frames transported without twist.
double bending_energy(const std::vector<Vec3d>& tangents, const std::vector<Vec3d>& rest, double length) {
    Eigen::Quaterniond frame = Eigen::Quaterniond::Identity(), rest_frame = frame;
    Vec3d t = rest[0], rest_t = rest[0];
    double energy = 0.0;
    for (size_t i = 0; i < tangents.size(); ++i) {
        auto turn = [](Vec3d& from, const Vec3d& to, Eigen::Quaterniond& turning) {
            const Vec3d axis = from.cross(to);
            const double angle = std::atan2(axis.norm(), from.dot(to));
            const Vec3d v = axis.norm() > 0.0 ? Vec3d(angle * axis.normalized()) : Vec3d::Zero();
            const Vec3d own = turning.conjugate() * v;
            if (angle > 0.0) turning = Eigen::AngleAxisd(angle, axis.normalized()) * turning;
            from = to;
            return own;
        };
        const Vec3d bend = turn(t, tangents[i], frame) - turn(rest_t, rest[i], rest_frame);
        energy += 0.5 * bend.squaredNorm() / (i == 0 ? 0.5 * length : length);
    }
    return energy;
}

TEST(OracleElastica, UnderWeightAloneTheEnergyIsStationary) {
    // Independent of moments: a moment along the tangent does no work, since the blade does not twist.
    double error[2] = {0.0, 0.0};
    for (int refinement : {0, 1}) {
        const int n = 128 << refinement;
        Blade helix = straight_blade(x, n, 0.0, -20.0);
        std::vector<Vec3d> rest;
        for (int k = 0; k < n; ++k) {
            const double u = (k + 0.5) / n;
            rest.push_back(Vec3d(1.0, std::cos(5.0 * u), std::sin(5.0 * u)).normalized());
            helix.rest[size_t(k) + 1] = helix.rest[size_t(k)] + rest.back() / n;
        }
        const Pose pose = elastica(helix, 1);
        ASSERT_TRUE(pose.converged);
        double twisting = 0.0;
        for (int k = 0; k < n; ++k)
            twisting = std::max(twisting, std::abs(pose.moments[size_t(k)].dot(pose.tangents[size_t(k)])));
        EXPECT_GT(twisting, 0.3) << "the test needs one";
        Draw draw(3);
        for (int trial = 0; trial < 20; ++trial) {
            const Vec3d a = draw.in_cube(), b = draw.in_cube(), c = draw.in_cube();
            double bending[2], weight[2];
            for (int side : {0, 1}) {
                std::vector<Vec3d> tangents = pose.tangents;
                weight[side] = 0.0;
                Vec3d at = Vec3d::Zero();
                for (int k = 0; k < n; ++k) {
                    const double s = (k + 0.5) / n;
                    Vec3d& t = tangents[size_t(k)];
                    t += (side == 0 ? -1e-4 : 1e-4) * s * (a + std::cos(3.0 * s) * b + std::cos(6.0 * s) * c);
                    t.normalize();
                    weight[side] += 20.0 / n * (at + 0.5 / n * t).y();
                    at += t / n;
                }
                bending[side] = bending_energy(tangents, rest, 1.0 / n);
            }
            const double work = weight[1] - weight[0], stored = bending[1] - bending[0];
            error[refinement] = std::max(error[refinement], std::abs(work + stored) / 2e-4);
        }
    }
    EXPECT_LT(error[1], 1e-3); // the parts are of the order of 1 to 10
    EXPECT_NEAR(error[0] / error[1], 4.0, 0.4) << error[1];
}

TEST(OracleElastica, TurningTheWorldAboutTheVerticalTurnsThePose) {
    Draw draw(4);
    for (int i = 0; i < 10; ++i) {
        Blade blade = random_blade(draw, 1e4, 50.0);
        const Pose pose = elastica(blade, 4);
        const Eigen::AngleAxisd turn(2.0 * pi * draw.unit(), y);
        for (Vec3d& cv : blade.rest) cv = turn * cv;
        blade.wind = turn * blade.wind;
        Pose turned = elastica(blade, 4);
        for (Vec3d& point : turned.points) point = turn.inverse() * point;
        EXPECT_EQ(pose.snapped, turned.snapped);
        EXPECT_LT(max_distance(pose.points, turned.points), 1e-9);
    }
}

std::vector<Vec3d> extrapolated(const Pose& coarse, const Pose& fine) {
    std::vector<Vec3d> points = fine.points;
    for (size_t k = 0; k < points.size(); ++k) points[k] += (fine.points[k] - coarse.points[k]) / 3.0;
    return points;
}

TEST(OracleElastica, ErrorsAreOfSecondOrderAndOfFourthOnceExtrapolated) {
    Draw draw(5);
    for (int i = 0; i < 10; ++i) {
        const Blade blade = random_blade(draw, 1e3, 50.0);
        Pose pose[4];
        for (int refinement = 0; refinement < 4; ++refinement)
            pose[refinement] = elastica(blade, 8 << refinement);
        const double coarse = max_distance(pose[1].points, pose[2].points);
        const double fine = max_distance(pose[2].points, pose[3].points);
        EXPECT_NEAR(coarse / fine, 4.0, 0.2) << i << ": " << fine;
        EXPECT_LT(fine, 1e-4);
        const std::vector<Vec3d> middle = extrapolated(pose[1], pose[2]);
        const double coarse_4 = max_distance(extrapolated(pose[0], pose[1]), middle);
        const double fine_4 = max_distance(middle, extrapolated(pose[2], pose[3]));
        EXPECT_NEAR(coarse_4 / fine_4, 16.0, 2.0) << i << ": " << fine_4;
        EXPECT_LT(fine_4, 1e-6);
    }
}

TEST(OracleElastica, WindAlongAStraightBladeLeavesItStraight) {
    for (double sign : {1.0, -1.0})
        for (double buoyancy : {-7.0, 0.0, 50.0}) {
            Blade blade = straight_blade(y, 4, 1e4, buoyancy);
            blade.wind = sign * y;
            const Pose pose = elastica(blade, 16);
            EXPECT_TRUE(pose.converged && !pose.snapped);
            EXPECT_LT(max_distance(pose.points, blade.rest), 1e-9);
        }
}

TEST(OracleElastica, NearlyOpposedWindTurnsTheBladeOverInASnap) {
    Blade blade = straight_blade(y, 4, 1e4, 0.0);
    blade.wind = Vec3d(std::sin(175.0 * degree), std::cos(175.0 * degree), 0.0);
    const Pose pose = elastica(blade, 32);
    EXPECT_TRUE(pose.converged && pose.snapped);
    EXPECT_LT(pose.points.back().y(), -0.8);
}

TEST(OracleElastica, APlanarBladeThatBucklesSidewaysSaysSo) {
    // A blade leaning into the wind falls out of the plane of its loads, to either side.
    Blade blade = straight_blade(Vec3d(1.0, 1.0, 0.0).normalized(), 12, 3.0, -15.0);
    for (int k = 0; k < 12; ++k) {
        const double angle = 20.0 * degree - 0.5 * (k + 0.5) / 12.0;
        blade.rest[size_t(k) + 1] =
            blade.rest[size_t(k)] + Vec3d(std::sin(angle), std::cos(angle), 0.0) / 12.0;
    }
    blade.wind = -x;
    const Pose pose = elastica(blade, 8);
    EXPECT_TRUE(pose.converged && pose.buckled && !pose.snapped);
    EXPECT_GT(std::abs(pose.points.back().z()), 0.3);
}

TEST(OracleElastica, RandomBladesConverge) {
    Draw draw(6);
    int snapped = 0, buckled = 0, fluttering = 0;
    const int count = 200;
    for (int i = 0; i < count; ++i) {
        const Blade blade = random_blade(draw, 1e4, 50.0);
        const Pose pose = elastica(blade, int(96 / blade.rest.size()) + 1);
        EXPECT_TRUE(pose.converged) << i << " at " << pose.load_factor;
        EXPECT_LT(pose.residual, 1e-10) << i;
        snapped += pose.snapped, buckled += pose.buckled, fluttering += pose.flutters;
    }
    std::printf("Of %d blades, Ca 0.1 to 1e4, |B| up to 50: %d snap, %d buckle, %d flutter\n", count, snapped,
                buckled, fluttering);
    EXPECT_LE(snapped, count / 20);
}

} // namespace
} // namespace marram::oracle
