// SPDX-License-Identifier: Apache-2.0
// Fields of the wind against their definition (local_wind.h), evaluated root by root.
#include "procedural/wind/local_wind.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>

namespace marram::testing::local {
namespace {

const Ramp fall(std::array{0.0, 1.0, 0.5, 1.0, 1.0, 0.0}, "smooth");
const Ramp response(std::array{0.0, 0.0, 4.0, 0.7, 12.0, 1.0}, "linear");

struct Random {
    uint64_t state = 7;
    double operator()(double low, double high) {
        state = hash(state, 1);
        return low + (high - low) * unit_double(state);
    }
    Vec3d vector(double most) { return {(*this)(-most, most), (*this)(-most, most), (*this)(-most, most)}; }
};

PlacedField random_field(Random& random, bool box, bool replaces) {
    PlacedField field;
    field.shape = box ? FieldShape::box : FieldShape::sphere;
    field.replaces = replaces;
    const Vec3d at = random.vector(1.0), turn = random.vector(180.0), scale = random.vector(1.0);
    const std::array keys = {1.0,
                             at.x(),
                             at.y(),
                             at.z(),
                             turn.x(),
                             turn.y(),
                             turn.z(),
                             0.5 + std::abs(scale.x()),
                             -0.5 - std::abs(scale.y()),
                             0.5 + std::abs(scale.z())};
    field.transform = KeyedTransform(keys, "linear");
    field.velocity = random.vector(4.0);
    field.swirl = random(-6.0, 6.0);
    field.pull = random(-6.0, 6.0);
    field.core = random(0.05, 1.0);
    field.weight = random(0.1, 1.0);
    field.ramp = fall;
    return field;
}

double scully(double q, double core) { return 2.0 * (q / core) / (1.0 + (q / core) * (q / core)); }

// The wind's velocity at a point, by the definition.
Vec3d velocity_at(const std::vector<PlacedField>& fields, const Vec3d& mean, const Vec3d& p) {
    Vec3d v = mean;
    for (const PlacedField& field : fields) {
        const Eigen::Affine3d transform = field.transform.at(1.0);
        const Vec3d x = transform.inverse() * p;
        const double r = x.norm(), t = field.shape == FieldShape::box ? x.cwiseAbs().maxCoeff() : r;
        if (!(t < 1.0)) continue;
        const Vec3d across(x.x(), 0.0, x.z());
        Vec3d f = field.velocity;
        if (across.norm() > 0.0)
            f += field.swirl * scully(across.norm(), field.core) * Vec3d::UnitY().cross(across.normalized());
        if (r > 0.0) f -= field.pull * scully(r, field.core) * x / r;
        Eigen::Matrix3d axes = transform.linear();
        for (int axis = 0; axis < 3; ++axis) axes.col(axis).normalize();
        const Vec3d world = axes * f;
        const double s = field.weight * fall(t);
        v += s * (field.replaces ? Vec3d(world - v) : world);
    }
    return v;
}

Strands strands_at(const std::vector<Vec3d>& roots) {
    Strands strands;
    strands.resize(int(roots.size()), 2, false);
    for (int i = 0; i < strands.blocks * lanes; ++i)
        for (int k = 0; k < 2; ++k)
            set_lane(strands.rest[size_t(i / lanes) * 2 + size_t(k)], i % lanes,
                     roots[size_t(std::min(i, strands.count - 1))] + k * Vec3d(0, 0.1, 0));
    return strands;
}

TEST(LocalWind, IsThatOfItsDefinition) {
    Random random;
    double worst = 0.0, worst_turn = 0.0;
    size_t inside = 0;
    for (int round = 0; round < 200; ++round) {
        std::vector<PlacedField> fields;
        for (int i = 0; i <= round % 3; ++i)
            fields.push_back(random_field(random, (round + i) % 2, round % 5 == 0));
        std::vector<Vec3d> roots;
        for (int i = 0; i < 37; ++i) roots.push_back(random.vector(2.0).cast<float>().cast<double>());
        const Vec3d direction = random.vector(1.0).normalized();
        const double speed = round % 4 == 0 ? 0.0 : random(0.0, 10.0);
        Strands strands = strands_at(roots);
        local_wind({direction, speed, response, fields_at(fields, 1.0)}, strands);
        for (size_t i = 0; i < roots.size(); ++i) {
            const Vec3d v = velocity_at(fields, speed * direction, roots[i]);
            const int lane = int(i % lanes);
            const Wide3d& w = strands.wind_direction[i / lanes];
            const Vec3d got(w.x[lane], w.y[lane], w.z[lane]);
            ASSERT_NEAR(got.norm(), 1.0, 1e-14);
            worst = std::max(worst, std::abs(double(strands.wind_response[i / lanes][lane]) -
                                             std::clamp(response(v.norm()), 0.0, 1.0)));
            if (v.norm() > 1e-3) worst_turn = std::max(worst_turn, (got - v.normalized()).norm() * v.norm());
            inside += (v - speed * direction).norm() > 0.0;
        }
    }
    std::printf("response off by %.2g, velocity by %.2g m/s, %zu roots in fields\n", worst, worst_turn,
                inside);
    EXPECT_LT(worst, 1e-6);
    EXPECT_LT(worst_turn, 1e-12);
    EXPECT_GT(inside, 1000U);
}

// In the middle of a whirl, on its axis, at its surface, outside: finite, continuous, and the mean wind
// outside.
TEST(LocalWind, IsSmoothInTheMiddleAndEndsAtTheSurface) {
    PlacedField whirl;
    whirl.swirl = 5.0;
    whirl.pull = 2.0;
    whirl.ramp = fall;
    const std::vector<PlacedField> fields = {whirl};
    Vec3d before = Vec3d::Zero();
    for (int i = -12000; i <= 12000; ++i) {
        Strands strands = strands_at({Vec3d(i * 1e-4, 0, 0)});
        local_wind({Vec3d::UnitZ(), 3.0, response, fields_at(fields, 1.0)}, strands);
        const Wide3d& w = strands.wind_direction[0];
        const Vec3d now(w.x[0], w.y[0], w.z[0]);
        ASSERT_TRUE(now.allFinite());
        if (i > -12000) {
            ASSERT_LT((now - before).norm(), 4e-3) << i;
        }
        if (std::abs(i) > 10000) {
            EXPECT_EQ(now, Vec3d::UnitZ());
        }
        before = now;
    }
}

// How strands are grouped does not matter, nor do fields elsewhere.
TEST(LocalWind, HasTheSameBitsInAnyPatch) {
    Random random;
    std::vector<PlacedField> fields;
    for (int i = 0; i < 5; ++i) fields.push_back(random_field(random, i % 2, i % 3 == 0));
    std::vector<Vec3d> roots;
    for (int i = 0; i < 64; ++i) roots.push_back(random.vector(2.0));
    Strands all = strands_at(roots);
    local_wind({Vec3d::UnitX(), 4.0, response, fields_at(fields, 1.0)}, all);
    for (size_t i = 0; i < roots.size(); ++i) {
        Strands one = strands_at({roots[i]});
        local_wind({Vec3d::UnitX(), 4.0, response, fields_at(fields, 1.0)}, one);
        const int lane = int(i % lanes);
        EXPECT_EQ(one.wind_response[0][0], all.wind_response[i / lanes][lane]);
        EXPECT_EQ(one.wind_direction[0].x[0], all.wind_direction[i / lanes].x[lane]);
        EXPECT_EQ(one.wind_direction[0].y[0], all.wind_direction[i / lanes].y[lane]);
        EXPECT_EQ(one.wind_direction[0].z[0], all.wind_direction[i / lanes].z[lane]);
    }
}

// With fields_at = "cv" CV k has the wind of a strand that is rooted there, bit for bit.
TEST(LocalWind, IsAtEachCvThatOfARootThere) {
    Random random;
    std::vector<PlacedField> fields;
    for (int i = 0; i < 5; ++i) fields.push_back(random_field(random, i % 2, i % 3 == 0));
    std::vector<Vec3d> roots;
    for (int i = 0; i < 29; ++i) roots.push_back(random.vector(2.0));
    const auto blow = [&](Strands& strands, bool at_cvs) {
        LocalWind wind{Vec3d::UnitX(), 4.0, response, {}};
        const std::vector<FieldAt> at = fields_at(fields, 1.0);
        wind.fields = at;
        wind.at_cvs = at_cvs;
        local_wind(wind, strands);
    };
    Strands both = strands_at(roots), bottom = both, top = both;
    for (int i = 0; i < top.blocks; ++i) top.rest[size_t(i) * 2] = top.rest[size_t(i) * 2 + 1];
    blow(both, true);
    blow(bottom, false);
    blow(top, false);
    for (int i = 0; i < both.blocks; ++i)
        for (int k = 0; k < 2; ++k) {
            const Strands& one = k == 0 ? bottom : top;
            const size_t at = both.wind_at(i, k), from = one.wind_at(i, 0);
            for (int lane = 0; lane < lanes; ++lane) {
                EXPECT_EQ(both.wind_response[at][lane], one.wind_response[from][lane]);
                EXPECT_EQ(both.wind_speed[at][lane], one.wind_speed[from][lane]);
                EXPECT_EQ(both.wind_direction[at].x[lane], one.wind_direction[from].x[lane]);
                EXPECT_EQ(both.wind_direction[at].y[lane], one.wind_direction[from].y[lane]);
                EXPECT_EQ(both.wind_direction[at].z[lane], one.wind_direction[from].z[lane]);
            }
        }
}

} // namespace
} // namespace marram::testing::local
