// SPDX-License-Identifier: Apache-2.0
// Fields of the wind from grids, images and curves against closed forms.
#include "procedural/wind/local_wind.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>

namespace marram::testing::shapes {
namespace {

const Ramp whole(std::array{0.0, 1.0, 0.999, 1.0, 1.0, 0.0}, "linear");
const Ramp response(std::array{0.0, 0.0, 40.0, 1.0}, "linear");

using Velocity = std::function<Vec3d(const Vec3d&)>;

// A volume that owns its numbers: a grid a frame, all in one place.
struct Volume {
    std::vector<std::vector<float>> values;
    std::vector<MarramGrid> grids;
    std::vector<double> frames;
    bool staggered = false;

    // Samples `velocity` at origin + axes (i, j, k); if staggered, each component on its face.
    void add(double frame, const std::array<uint32_t, 3>& n, const Vec3d& origin, const Eigen::Matrix3d& axes,
             const Velocity& velocity) {
        std::vector<float>& numbers = values.emplace_back();
        for (uint32_t k = 0; k < n[2]; ++k)
            for (uint32_t j = 0; j < n[1]; ++j)
                for (uint32_t i = 0; i < n[0]; ++i)
                    for (int c = 0; c < 3; ++c) {
                        Vec3d index(i, j, k);
                        if (staggered) index[c] -= 0.5;
                        numbers.push_back(float(velocity(origin + axes * index)[c]));
                    }
        MarramGrid& grid = grids.emplace_back();
        grid.name = "v";
        grid.nx = n[0], grid.ny = n[1], grid.nz = n[2];
        grid.components = 3;
        for (int a = 0; a < 3; ++a) {
            grid.origin[a] = origin[a];
            for (int c = 0; c < 3; ++c) grid.axes[a][c] = axes(c, a);
        }
        frames.push_back(frame);
    }
    PlacedField field() {
        for (size_t g = 0; g < grids.size(); ++g) grids[g].values = values[g].data();
        const MarramVolume volume{sizeof(MarramVolume), uint32_t(grids.size()), sizeof(MarramGrid),
                                  grids.data(),         frames.data(),          staggered ? 1U : 0U};
        PlacedField made;
        made.shape = FieldShape::grid;
        made.velocities = std::make_shared<const Velocities>(velocities_of(volume));
        made.ramp = whole;
        return made;
    }
};

Strands strands_at(const std::vector<Vec3d>& roots) {
    Strands strands;
    strands.resize(int(roots.size()), 2, false);
    for (int i = 0; i < strands.blocks * lanes; ++i)
        for (int k = 0; k < 2; ++k)
            set_lane(strands.rest[size_t(i / lanes) * 2 + size_t(k)], i % lanes,
                     roots[size_t(std::min(i, strands.count - 1))] + k * Vec3d(0, 0.1, 0));
    return strands;
}

// The local wind at each root.
std::vector<Vec3d> winds(std::span<const PlacedField> fields, const Vec3d& mean,
                         const std::vector<Vec3d>& roots, double frame = 1.0) {
    Strands strands = strands_at(roots);
    const double speed = mean.norm();
    local_wind({speed > 0.0 ? Vec3d(mean / speed) : Vec3d(Vec3d::UnitX()), speed, response,
                fields_at(fields, frame)},
               strands);
    std::vector<Vec3d> out;
    for (size_t i = 0; i < roots.size(); ++i) {
        const Wide3d& w = strands.wind_direction[i / lanes];
        const int lane = int(i % lanes);
        out.push_back(Vec3d(w.x[lane], w.y[lane], w.z[lane]) * double(strands.wind_speed[i / lanes][lane]));
    }
    return out;
}

struct Random {
    uint64_t state = 3;
    double operator()(double low, double high) {
        state = hash(state, 1);
        return low + (high - low) * unit_double(state);
    }
    Vec3d vector(double most) { return {(*this)(-most, most), (*this)(-most, most), (*this)(-most, most)}; }
};

Eigen::Matrix3d skewed_axes() {
    Eigen::Matrix3d axes;
    axes << 0.3, 0.05, 0.0, 0.0, 0.2, 0.02, 0.1, 0.0, 0.25;
    return axes;
}

Vec3d linear_velocity(const Vec3d& p) {
    Eigen::Matrix3d gradient;
    gradient << 0.5, -1.0, 2.0, 0.3, 0.7, -0.2, 1.5, 0.1, -0.9;
    return Vec3d(1.0, -2.0, 0.5) + gradient * p;
}

// Roots well inside the samples of a grid of n voxels.
std::vector<Vec3d> roots_inside(Random& random, const std::array<uint32_t, 3>& n, const Vec3d& origin,
                                const Eigen::Matrix3d& axes) {
    std::vector<Vec3d> roots;
    for (int i = 0; i < 300; ++i) {
        const Vec3d index(random(0.5, n[0] - 1.5), random(0.5, n[1] - 1.5), random(0.5, n[2] - 1.5));
        roots.push_back((origin + axes * index).cast<float>().cast<double>());
    }
    return roots;
}

// Trilinear interpolation has the linear fields exactly, but for rounding to floats.
TEST(FieldGrid, HasLinearVelocitiesExactly) {
    Random random;
    const std::array<uint32_t, 3> n = {7, 9, 11};
    const Vec3d origin(0.4, -0.7, 1.3);
    for (const bool staggered : {false, true}) {
        Volume volume;
        volume.staggered = staggered;
        volume.add(1.0, n, origin, skewed_axes(), linear_velocity);
        PlacedField field = volume.field();
        const std::vector<Vec3d> roots = roots_inside(random, n, origin, skewed_axes());
        for (const bool replaces : {false, true}) {
            field.replaces = replaces;
            const Vec3d mean(3.0, 0.0, -1.0);
            const std::vector<Vec3d> got = winds({&field, 1}, mean, roots);
            double worst = 0.0;
            for (size_t i = 0; i < roots.size(); ++i) {
                const Vec3d v = linear_velocity(roots[i]) + (replaces ? Vec3d(Vec3d::Zero()) : mean);
                worst = std::max(worst, (got[i] - v).norm());
            }
            std::printf("linear velocities, %s: off by %.2g m/s of %.3g\n",
                        staggered ? "staggered" : "at centres", worst, field.velocities->max_speed);
            EXPECT_LT(worst, 1e-6 * field.velocities->max_speed);
        }
    }
}

// A rigid rotation, in a field that is itself turned, scaled and moved: speeds are not scaled.
TEST(FieldGrid, TurnsWithItsTransform) {
    Random random;
    const std::array<uint32_t, 3> n = {8, 8, 8};
    const Vec3d origin = Vec3d::Constant(-0.35);
    const Eigen::Matrix3d axes = 0.1 * Eigen::Matrix3d::Identity();
    const Vec3d spin(0.2, 3.0, -0.4);
    Volume volume;
    volume.add(1.0, n, origin, axes, [&](const Vec3d& p) { return spin.cross(p); });
    PlacedField field = volume.field();
    const std::array keys = {1.0, 5.0, -2.0, 3.0, 30.0, 50.0, -70.0, 2.0, 3.0, 0.5};
    field.transform = KeyedTransform(keys, "linear");
    const Eigen::Affine3d transform = field.transform.at(1.0);
    Eigen::Matrix3d turn = transform.linear();
    for (int a = 0; a < 3; ++a) turn.col(a).normalize();
    std::vector<Vec3d> roots;
    for (const Vec3d& p : roots_inside(random, n, origin, axes))
        roots.push_back((transform * p).cast<float>().cast<double>());
    const std::vector<Vec3d> got = winds({&field, 1}, Vec3d::Zero(), roots);
    for (size_t i = 0; i < roots.size(); ++i)
        EXPECT_LT((got[i] - turn * spin.cross(transform.inverse() * roots[i])).norm(), 2e-6);
}

// Outside the box of its voxels, and where the weight is 0, the wind keeps its bits.
TEST(FieldGrid, LeavesTheMeanWindOutside) {
    Volume volume;
    volume.add(1.0, {4, 4, 4}, Vec3d::Zero(), Eigen::Matrix3d::Identity(),
               [](const Vec3d&) { return Vec3d(9, 9, 9); });
    PlacedField field = volume.field();
    Random random;
    std::vector<Vec3d> roots;
    size_t outside = 0;
    for (int i = 0; i < 800; ++i) roots.push_back(random.vector(6.0).cast<float>().cast<double>());
    Strands with = strands_at(roots), without = strands_at(roots);
    const Vec3d direction = Vec3d(1.0, 0.2, -0.3).normalized();
    local_wind({direction, 7.0, response, fields_at({&field, 1}, 1.0)}, with);
    local_wind({direction, 7.0, response, {}}, without);
    for (size_t i = 0; i < roots.size(); ++i) {
        const int lane = int(i % lanes);
        const bool in = ((roots[i].array() > -0.5) && (roots[i].array() < 3.5)).all();
        outside += !in;
        const bool same =
            with.wind_direction[i / lanes].x[lane] == without.wind_direction[i / lanes].x[lane] &&
            with.wind_direction[i / lanes].y[lane] == without.wind_direction[i / lanes].y[lane] &&
            with.wind_direction[i / lanes].z[lane] == without.wind_direction[i / lanes].z[lane] &&
            with.wind_response[i / lanes][lane] == without.wind_response[i / lanes][lane];
        EXPECT_EQ(same, !in) << roots[i].transpose();
    }
    EXPECT_GT(outside, 700u);
    field.weight = 0.0;
    EXPECT_TRUE(fields_at({&field, 1}, 1.0).empty());
}

// A voxel thick, or a single voxel.
TEST(FieldGrid, MayBeThin) {
    for (const std::array<uint32_t, 3> n : {std::array<uint32_t, 3>{5, 1, 5}, {1, 1, 1}}) {
        Volume volume;
        volume.add(1.0, n, Vec3d::Zero(), Eigen::Matrix3d::Identity(),
                   [](const Vec3d&) { return Vec3d(1, 2, 3); });
        PlacedField field = volume.field();
        const std::vector<Vec3d> got =
            winds({&field, 1}, Vec3d::Zero(), {Vec3d::Zero(), Vec3d(0, 0.4, 0), Vec3d(0, 0.6, 0)});
        EXPECT_LT((got[0] - Vec3d(1, 2, 3)).norm(), 1e-6);
        EXPECT_LT((got[1] - Vec3d(1, 2, 3)).norm(), 1e-6);
        EXPECT_EQ(got[2], Vec3d(Vec3d::Zero()));
    }
}

// Linear between frames, constant before and after; grids of other sizes in other places.
TEST(FieldGrid, IsLinearInTime) {
    Volume volume;
    const auto constant = [](const Vec3d& v) { return [v](const Vec3d&) { return v; }; };
    volume.add(3.0, {4, 4, 4}, Vec3d::Constant(-1.5), Eigen::Matrix3d::Identity(), constant({1, 0, 0}));
    volume.add(4.0, {4, 4, 4}, Vec3d::Constant(-1.5), Eigen::Matrix3d::Identity(), constant({0, 4, 0}));
    volume.add(8.0, {8, 8, 8}, Vec3d::Constant(-3.5), Eigen::Matrix3d::Identity(), constant({0, 0, 2}));
    PlacedField field = volume.field();
    const auto at = [&](double frame, const Vec3d& p) {
        return winds({&field, 1}, Vec3d::Zero(), {p}, frame)[0];
    };
    const Vec3d middle = Vec3d::Zero(), outer(3.0, 0.0, 0.0);
    const std::pair<double, Vec3d> expected[] = {{-5.0, {1, 0, 0}}, {3.0, {1, 0, 0}},   {3.25, {0.75, 1, 0}},
                                                 {4.0, {0, 4, 0}},  {5.0, {0, 3, 0.5}}, {8.0, {0, 0, 2}},
                                                 {99.0, {0, 0, 2}}};
    for (const auto& [frame, v] : expected) EXPECT_LT((at(frame, middle) - v).norm(), 1e-6) << frame;
    EXPECT_EQ(at(4.0, outer), Vec3d(Vec3d::Zero()));
    EXPECT_LT((at(5.0, outer) - Vec3d(0, 0, 0.5)).norm(), 1e-6);
    EXPECT_TRUE(field_moves(field));
    field.replaces = true;
    EXPECT_LT((winds({&field, 1}, Vec3d(8, 0, 0), {outer}, 5.0)[0] - Vec3d(6, 0, 0.5)).norm(), 1e-6);
    EXPECT_LT((winds({&field, 1}, Vec3d(8, 0, 0), {middle}, 5.0)[0] - Vec3d(0, 3, 0.5)).norm(), 1e-6);
    EXPECT_DOUBLE_EQ(max_added_speed(field, 8.0), 4.0);
}

PlacedField image_field(uint32_t nx, uint32_t ny, const std::vector<float>& pixels) {
    MarramGrid grid{};
    grid.nx = nx, grid.ny = ny, grid.nz = 1;
    grid.components = 2;
    grid.values = pixels.data();
    PlacedField field;
    field.shape = FieldShape::image;
    field.map = std::make_shared<const PlanMap>(image_map(grid, ""));
    field.ramp = whole;
    return field;
}

// (1, 0) changes nothing; across is from +x towards +z; rows run from the side at -z.
TEST(FieldImage, IsRelativeToTheMeanWind) {
    PlacedField same = image_field(1, 1, {1.0F, 0.0F});
    const Vec3d mean(4.0, 1.0, 2.0);
    EXPECT_LT((winds({&same, 1}, mean, {Vec3d(0.3, 5.0, 0.1)})[0] - mean).norm(), 1e-6);
    PlacedField across = image_field(1, 1, {0.0F, 1.0F});
    EXPECT_LT((winds({&across, 1}, Vec3d(4, 0, 0), {Vec3d(0.3, -9.0, 0.1)})[0] - Vec3d(0, 0, 4)).norm(),
              1e-6);
    EXPECT_LT((winds({&across, 1}, Vec3d(0, 0, 4), {Vec3d(0.3, -9.0, 0.1)})[0] - Vec3d(-4, 0, 0)).norm(),
              1e-6);
    // Four pixels: the first row lies at -z.
    PlacedField calm = image_field(2, 2, {0.0F, 0.0F, 1.0F, 0.0F, 2.0F, 0.0F, 3.0F, 0.0F});
    const auto speed = [&](double x, double z) {
        return winds({&calm, 1}, Vec3d(2, 0, 0), {Vec3d(x, 0.0, z)})[0].x() / 2.0;
    };
    EXPECT_NEAR(speed(-0.5, -0.5), 0.0, 1e-6);
    EXPECT_NEAR(speed(0.5, -0.5), 1.0, 1e-6);
    EXPECT_NEAR(speed(-0.5, 0.5), 2.0, 1e-6);
    EXPECT_NEAR(speed(0.9, 0.9), 3.0, 1e-6); // the outer half pixel
    EXPECT_NEAR(speed(0.0, 0.0), 1.5, 1e-6);
    EXPECT_EQ(winds({&calm, 1}, Vec3d(2, 0, 0), {Vec3d(1.5, 0, 0)})[0], Vec3d(2, 0, 0));
    const std::array keys = {1.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 1.0, 5.0};
    calm.transform = KeyedTransform(keys, "linear");
    EXPECT_NEAR(winds({&calm, 1}, Vec3d(2, 0, 0), {Vec3d(12.5, 100, -2.5)})[0].x(), 2.0, 1e-6);
    EXPECT_TRUE(field_touches(calm, Vec2d(1, 5), {Vec3d(14, 70, 4), Vec3d(20, 80, 20)}));
    EXPECT_FALSE(field_touches(calm, Vec2d(1, 5), {Vec3d(16, 70, 4), Vec3d(20, 80, 20)}));
}

TEST(FieldImage, IsRefusedIfItsNumbersAreNotUsable) {
    for (const float bad : {std::nanf(""), 11.0F, -INFINITY})
        EXPECT_THROW(image_field(1, 2, {1.0F, 0.0F, 1.0F, bad}), SceneFault);
}

PlacedField curves_field(const std::vector<DrawnCurve>& curves, double reach) {
    PlacedField field;
    field.shape = FieldShape::curves;
    field.reach = reach;
    field.ramp = Ramp(std::array{0.0, 1.0, 0.5, 1.0, 1.0, 0.0}, "smooth");
    field.map = std::make_shared<const PlanMap>(guide_map(curves, reach, field.ramp, "a.toml:1:1"));
    return field;
}

double angle_between(const Vec3d& a, const Vec3d& b) {
    return std::acos(std::clamp(a.dot(b) / a.norm() / b.norm(), -1.0, 1.0));
}

// A long straight curve: nearly all of its angle on it, half at its reach, none at four times that.
TEST(FieldCurves, TurnByHalfAtTheirReach) {
    const double reach = 5.0;
    for (const double angle : {20.0 * degree, 90.0 * degree, 120.0 * degree}) {
        DrawnCurve line;
        const Vec3d along(std::cos(angle), 0.0, std::sin(angle)), aside(-along.z(), 0.0, along.x());
        for (int i = -10; i <= 10; ++i) line.points.push_back(6.0 * i * along);
        PlacedField field = curves_field({line}, reach);
        for (const bool replaces : {false, true}) {
            field.replaces = replaces;
            const auto turn = [&](double d) {
                return angle_between(winds({&field, 1}, Vec3d(6, 0, 0), {Vec3d(d * aside)})[0],
                                     Vec3d(6, 0, 0)) /
                       angle;
            };
            EXPECT_GT(turn(0.0), 0.95) << angle;
            EXPECT_NEAR(turn(reach), 0.5, 0.03) << angle;
            EXPECT_NEAR(turn(-reach), 0.5, 0.03) << angle;
        }
        const Vec3d far = 4.05 * reach * aside;
        EXPECT_EQ(winds({&field, 1}, Vec3d(6, 0, 0), {far})[0], Vec3d(6, 0, 0));
        // The speed is that of the mean of both directions.
        EXPECT_NEAR(winds({&field, 1}, Vec3d(6, 0, 0), {Vec3d(reach * aside)})[0].norm(),
                    6.0 * std::cos(0.5 * angle), 0.2);
    }
}

// The map against the sum over all segments at the place itself: bilinear between samples.
TEST(FieldCurves, AreThoseOfTheirSum) {
    Random random;
    std::vector<DrawnCurve> curves(2);
    for (int i = 0; i < 12; ++i) {
        curves[0].points.emplace_back(2.0 * i, 0.0, 3.0 * std::sin(0.5 * i));
        curves[1].points.emplace_back(12.0 + 4.0 * std::cos(0.5 * i), 1.0, 8.0 + 4.0 * std::sin(0.5 * i));
    }
    curves[1].closed = true;
    const double reach = 3.0, cell = reach / 24.0;
    const PlacedField field = curves_field(curves, reach);
    const std::vector<GuideSegment> segments =
        guide_segments(curves, cell, Eigen::AlignedBox2d(Vec2d(-1e3, -1e3), Vec2d(1e3, 1e3)));
    const Vec3d mean(4.0, 0.5, -3.0);
    double worst = 0.0, square = 0.0;
    const int count = 2000;
    for (int i = 0; i < count; ++i) {
        const Vec3d p(random(0.0, 22.0), 0.0, random(-3.0, 12.0));
        double weights = pi / reach, nearest = 1e9;
        Vec2d sum = weights * Vec2d(mean.x(), mean.z());
        for (const GuideSegment& s : segments) {
            const double w = guide_weight(Vec2d(p.x(), p.z()), s, cell);
            weights += w;
            sum += w * 5.0 / s.length * (s.b - s.a);
            const Vec2d to = Vec2d(p.x(), p.z()) - s.a, along = (s.b - s.a) / s.length;
            nearest = std::min(nearest, (to - std::clamp(to.dot(along), 0.0, s.length) * along).norm());
        }
        const double influence = field.ramp(nearest / (4.0 * reach));
        const Vec3d own(sum.x() / weights, mean.y(), sum.y() / weights),
            expected = mean + influence * (own - mean);
        const double off = (winds({&field, 1}, mean, {p})[0] - expected).norm();
        worst = std::max(worst, off);
        square += off * off;
    }
    std::printf("map of curves: off by %.3g m/s of 5 at most, %.2g rms\n", worst, std::sqrt(square / count));
    EXPECT_LT(worst, 0.25);
    EXPECT_LT(std::sqrt(square / count), 0.02);
}

TEST(FieldCurves, AreRefusedIfTheyAreTooShortOrTooLong) {
    const DrawnCurve point{{{1.0, 0.0, 1.0}, {1.0, 3.0, 1.0}}, false}, none{};
    const DrawnCurve road{{{0.0, 0.0, 0.0}, {1e5, 0.0, 1e5}}, false};
    EXPECT_THROW(curves_field({point}, 1.0), SceneFault);
    EXPECT_THROW(curves_field({none}, 1.0), SceneFault);
    EXPECT_THROW(curves_field({}, 1.0), SceneFault);
    EXPECT_THROW(curves_field({road}, 1.0), SceneFault);
    EXPECT_NO_THROW(curves_field({road}, 300.0));
}

// How strands are grouped does not matter, nor do roots elsewhere.
TEST(FieldShapes, HaveTheSameBitsInAnyPatch) {
    Random random;
    Volume volume;
    volume.staggered = true;
    volume.add(1.0, {9, 7, 5}, Vec3d::Constant(-1.0), skewed_axes(), linear_velocity);
    volume.add(2.0, {9, 7, 5}, Vec3d::Constant(-1.0), skewed_axes(), [](const Vec3d& p) { return p; });
    const DrawnCurve line{{{-2, 0, -1}, {2, 0, 1}}, false};
    std::vector<PlacedField> fields = {volume.field(), image_field(2, 1, {1.0F, 0.5F, 0.2F, 0.0F}),
                                       curves_field({line}, 0.5)};
    fields[2].replaces = true;
    fields[1].weight = 0.7;
    std::vector<Vec3d> roots;
    for (int i = 0; i < 101; ++i) roots.push_back(random.vector(2.0));
    const std::vector<Vec3d> all = winds(fields, Vec3d(3, 0, 1), roots, 1.3);
    for (size_t i = 0; i < roots.size(); ++i)
        EXPECT_EQ(winds(fields, Vec3d(3, 0, 1), {roots[i]}, 1.3)[0], all[i]);
}

} // namespace
} // namespace marram::testing::shapes
