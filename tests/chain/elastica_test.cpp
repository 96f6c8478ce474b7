// SPDX-License-Identifier: Apache-2.0
// Compares the elastica with the oracle's, which shares no code with it.
#include "procedural/wind/blade/elastica.h"
#include "procedural/wind/strands.h"

#include "core/math/hash.h"
#include "tests/oracle/elastica.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

using namespace marram;

namespace {

struct Case {
    oracle::Blade blade;
    double length = 0.0, ca = 0.0;
};

// A blade with 8 CVs, tapering rigidity and uniform loads.
Case random_case(uint64_t seed) {
    const auto draw = [&](uint64_t i) { return 2.0 * unit_double(hash(seed, i)) - 1.0; };
    const auto unit = [&](uint64_t i, double lift) -> Vec3d {
        return (Vec3d(draw(i), draw(i + 1), draw(i + 2)) + Vec3d(0.0, lift, 0.0)).normalized();
    };
    constexpr int n = 8;
    Case c;
    c.length = 0.5 + 0.4 * draw(0);
    c.ca = std::pow(10.0, 1.0 + 2.0 * draw(1)); // 0.1 to 10^3
    const double b = 5.0 * draw(2) * std::min(1.0, c.ca), speed = 11.0 + 10.0 * draw(3), rigidity = 1e-4;
    const double unit_load = rigidity / (c.length * c.length * c.length);
    Vec3d tangent = unit(4, 2.0), point = Vec3d::Zero();
    const Eigen::AngleAxisd turn(1.0 / (n - 1), unit(7, 0.0));
    c.blade.wind = speed * unit(10, 0.0);
    for (int k = 0; k < n; ++k) {
        c.blade.rest.push_back(point.cast<float>().cast<double>());
        c.blade.rigidity.push_back(rigidity * (1.0 - 0.5 * k / (n - 1)));
        c.blade.drag.push_back(c.ca * unit_load / (speed * speed));
        c.blade.mass.push_back(b * unit_load / 9.81);
        point += tangent * (c.length / (n - 1));
        tangent = turn * tangent;
    }
    return c;
}

std::vector<Vec3d> elastica_pose(const Case& c, int pieces) {
    const size_t n = c.blade.rest.size();
    WideVector<Wide3f> rest(n), pose(n), wind(n);
    WideVector<VFloat> rigidity(n), drag(n), weight(n);
    for (size_t k = 0; k < n; ++k)
        for (int lane = 0; lane < lanes; ++lane) {
            set_lane(rest[k], lane, c.blade.rest[k]);
            set_lane(wind[k], lane, c.blade.wind);
            rigidity[k][lane] = float(c.blade.rigidity[k]);
            drag[k][lane] = float(c.blade.drag[k]);
            weight[k][lane] = float(c.blade.mass[k] * 9.81);
        }
    ElasticaScratch scratch;
    elastica({int(n), pieces, rest.data(), nullptr, pose.data(), nullptr, rigidity.data(), drag.data(),
              weight.data(), wind.data(), 1e-4 * c.length},
             scratch);
    std::vector<Vec3d> points;
    for (const Wide3f& p : pose) points.emplace_back(double(p.x[0]), double(p.y[0]), double(p.z[0]));
    return points;
}

} // namespace

TEST(Elastica, AgreesWithTheOracle) {
    std::vector<std::pair<Case, oracle::Pose>> blades;
    int left = 0;
    for (uint64_t i = 0; i < 250; ++i) {
        const Case c = random_case(i);
        const oracle::Pose expected = oracle::elastica(c.blade, 16);
        if (expected.converged && !expected.snapped && !expected.buckled)
            blades.emplace_back(c, expected);
        else
            ++left;
    }
    for (const int pieces : {2, 8}) {
        std::vector<double> errors, arc_errors;
        for (const auto& [c, expected] : blades) {
            const std::vector<Vec3d> points = elastica_pose(c, pieces);
            double error = 0.0, arc_error = 0.0;
            Vec3d chain = c.blade.rest[0]; // segments along the chords, with the lengths of the rest
            for (size_t k = 1; k < points.size(); ++k) {
                const double length = (c.blade.rest[k] - c.blade.rest[k - 1]).norm();
                chain += length * (expected.points[k] - expected.points[k - 1]).normalized();
                error = std::max(error, (points[k] - chain).norm() / c.length);
                arc_error = std::max(arc_error, (points[k] - expected.points[k]).norm() / c.length);
            }
            errors.push_back(error);
            arc_errors.push_back(arc_error);
        }
        std::ranges::sort(errors);
        std::ranges::sort(arc_errors);
        const size_t last = errors.size() - 1;
        std::printf("%d pieces, %zu blades (%d snapped or buckled left out): median %.2g, 95 %% %.2g, 99 %% "
                    "%.2g, worst "
                    "%.2g of the length; CVs from the continuous blade: median %.2g, 99 %% %.2g\n",
                    pieces, errors.size(), left, errors[last / 2], errors[last * 95 / 100],
                    errors[last * 99 / 100], errors[last], arc_errors[last / 2], arc_errors[last * 99 / 100]);
        EXPECT_LT(errors[last * 95 / 100], pieces == 2 ? 4e-3 : 4e-4);
        EXPECT_LT(left, 60);
    }
}
