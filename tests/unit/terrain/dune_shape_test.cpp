// SPDX-License-Identifier: Apache-2.0
// Compares the dune along a curve with an evaluation of its documented formulas by quadrature. Also tests
// what the documentation states: continuity, height of the crest, angle of the slip face, bounds, identical
// bits in rows and at any thread count.
#include "procedural/terrain/dune/dune_shape.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cstring>
#include <limits>

namespace marram {
namespace {

using Points = std::vector<Vec2d>;
using Real = long double;

Ramp ramp(std::vector<double> knots, const char* how = "linear") { return Ramp(knots, how); }

// The documented formulas; integrals by 8-point Gauss-Legendre quadrature on panels that double in size away
// from t = 0.
class Quadrature {
  public:
    Quadrature(const DuneShape& dune, const DuneSettings& settings)
        : s_(settings), crest_(dune.crest_points()) {
        const Vec2d chord = crest_.back().at - crest_.front().at;
        if (s_.outer_slope_stretch > 1.0 && chord.norm() > 0.0) {
            const Vec2d across = Eigen::Rotation2Dd(s_.outer_slope_turn) * chord.normalized();
            matrix_ += (s_.outer_slope_stretch - 1.0) * across * across.transpose();
        }
    }

    DuneSample at(const Vec2d& p) const {
        const Means o = means(p, matrix_), i = means(p, Eigen::Matrix2d::Identity());
        const auto rounded = [&](Real d) {
            const Real r = s_.crest_radius;
            return std::sqrt(d * d + r * r) - r;
        };
        const Real b = o.share, xo = rounded(o.d) / std::max(o.outer, o.eps),
                   xi = rounded(i.d) / std::max(i.inner, i.eps);
        const Real so = xo < 1.0L ? s_.outer_slope_shape(double(std::pow(xo, 1.0L / (1.0L + o.pinch)))) : 0.0;
        Real si = xi < 1.0L ? s_.inner_slope_shape(double(std::pow(xi, 1.0L / (1.0L + i.pinch)))) : 0.0;
        if (s_.inner_slope_angle > 0.0) si = std::max(1.0L - xi, 0.0L);
        const Real xm =
            s_.max_dist > 0.0 ? i.d / s_.max_dist : b * std::min(xo, 1.0L) + (1.0L - b) * std::min(xi, 1.0L);
        DuneSample out;
        out.height = double(b * o.height * so + (1.0L - b) * i.height * si);
        out.mask = xm < 1.0L ? s_.mask_fall_off(double(xm)) : 0.0;
        out.dist = double(i.d);
        out.outer = double(b);
        out.sample_dir = i.direction;
        return out;
    }

  private:
    struct Means {
        Real eps, d, share, height, outer, inner, pinch;
        Vec2d direction;
    };
    Means means(const Vec2d& p, const Eigen::Matrix2d& matrix) const {
        std::vector<DuneCrestPoint> crest = crest_;
        Real longest = 0.0L;
        for (size_t i = 0; i < crest.size(); ++i) {
            crest[i].at = matrix * crest[i].at;
            if (i > 0) longest = std::max(longest, Real((crest[i].at - crest[i - 1].at).norm()));
        }
        const Real eps = std::max(1e-3L * s_.slope_width / s_.search_accuracy, 1e-5L * longest);
        Real sum[8] = {}; // integrals of 1, height, outer, inner, pinch, side, x, z
        for (size_t i = 1; i < crest.size(); ++i) add_segment(crest[i - 1], crest[i], matrix * p, eps, sum);
        const Real d4 = 1.0L / (0.75L * sum[0]), distance = std::sqrt(std::sqrt(d4));
        const Real sigma = std::clamp(0.5L + sum[5] / (sum[0] * distance), 0.0L, 1.0L);
        const Real norm = std::hypot(sum[6], sum[7]);
        return {eps,
                std::sqrt(std::max(distance * distance - eps * eps, 0.0L)),
                sigma * sigma * (3.0L - 2.0L * sigma),
                sum[1] / sum[0],
                sum[2] / sum[0],
                sum[3] / sum[0],
                sum[4] / sum[0],
                Vec2d(double(sum[6] / norm), double(sum[7] / norm))};
    }
    void add_segment(const DuneCrestPoint& a, const DuneCrestPoint& b, const Vec2d& p, Real eps,
                     Real sum[8]) const {
        const Real ux = Real(b.at.x()) - a.at.x(), uz = Real(b.at.y()) - a.at.y(), l = std::hypot(ux, uz);
        const Real dx = Real(p.x()) - a.at.x(), dz = Real(p.y()) - a.at.y();
        const Real foot = (dx * ux + dz * uz) / l; // position along the segment from its start
        const Real side = (dx * uz - dz * ux) / l * (s_.flip ? -1.0L : 1.0L);
        const Real scale = 0.5L * std::sqrt(side * side + eps * eps);
        for (int way = -1; way <= 1; way += 2) { // in both directions from the foot, or from the nearer end
            const Real begin = std::clamp(foot, 0.0L, l), end = way < 0 ? 0.0L : l;
            for (Real from = begin, size = scale + 0.5L * std::abs(foot - begin); way * (end - from) > 0.0L;
                 size *= 2.0L) {
                const Real to = way < 0 ? std::max(end, from - size) : std::min(end, from + size);
                add_panel(a, b, p, from, to, l, side, eps, sum);
                from = to;
            }
        }
    }
    void add_panel(const DuneCrestPoint& a, const DuneCrestPoint& b, const Vec2d& p, Real from, Real to,
                   Real l, Real side, Real eps, Real sum[8]) const {
        static constexpr Real nodes[] = {0.1834346424956498049L, 0.5255324099163289858L,
                                         0.7966664774136267396L, 0.9602898564975362317L};
        static constexpr Real weights[] = {0.3626837833783619830L, 0.3137066458778872873L,
                                           0.2223810344533744705L, 0.1012285362903762592L};
        for (int k = 0; k < 8; ++k) {
            const Real node = (k % 2 ? -1.0L : 1.0L) * nodes[k / 2];
            const Real t = 0.5L * (from + to) + 0.5L * (to - from) * node, v = t / l;
            const Real x = a.at.x() + v * (b.at.x() - a.at.x()) - p.x(),
                       z = a.at.y() + v * (b.at.y() - a.at.y()) - p.y();
            const Real r2 = x * x + z * z + eps * eps;
            const Real w = weights[k / 2] * 0.5L * std::abs(to - from) / (r2 * r2 * std::sqrt(r2));
            const double u = double(a.along + v * (b.along - a.along));
            const Real h = s_.max_height * s_.main_curve_shape(u);
            const Real inner = s_.inner_slope_angle > 0.0
                                   ? h / std::tan(Real(s_.inner_slope_angle))
                                   : a.inner_width + v * (b.inner_width - a.inner_width);
            const Real values[] = {1.0L,
                                   h,
                                   a.outer_width + v * (b.outer_width - a.outer_width),
                                   inner,
                                   a.pinch + v * (b.pinch - a.pinch),
                                   side,
                                   x,
                                   z};
            for (int f = 0; f < 8; ++f) sum[f] += values[f] * w;
        }
    }

    DuneSettings s_;
    std::vector<DuneCrestPoint> crest_;
    Eigen::Matrix2d matrix_ = Eigen::Matrix2d::Identity(); // of the plane of the outer slope
};

Points circle(double radius, int count, double turns = 1.0) {
    Points points;
    for (int i = 0; i < count; ++i) {
        const double a = 2.0 * pi * turns * i / count;
        points.emplace_back(radius * std::cos(a), radius * std::sin(a));
    }
    return points;
}
Points figure_of_eight() {
    Points points;
    for (int i = 0; i < 120; ++i) {
        const double a = 2.0 * pi * i / 120.0;
        points.emplace_back(40.0 * std::sin(a), 25.0 * std::sin(2.0 * a));
    }
    return points;
}
Points spiral() {
    Points points;
    for (int i = 0; i < 300; ++i) {
        const double a = 0.05 * i;
        points.emplace_back((4.0 + 1.6 * a) * std::cos(a), (4.0 + 1.6 * a) * std::sin(a));
    }
    return points;
}
Points arc() { // the crest of a barchan
    Points points;
    for (int i = 0; i <= 30; ++i) points.emplace_back(i - 15.0, 0.04 * (i - 15.0) * (i - 15.0));
    return points;
}
const Points line = {{-40.0, 0.0}, {40.0, 0.0}};
const Points sharp_v = {{-30.0, -8.0}, {0.0, 0.0}, {-30.0, 8.0}};

DuneSettings plain() { // smooth except at the crest
    DuneSettings s;
    s.inner_slope_shape = s.outer_slope_shape;
    return s;
}
DuneSettings rich() {
    DuneSettings s;
    s.main_curve_shape = ramp({0.0, 0.2, 0.37, 1.0, 0.8, 0.5, 1.0, 0.1}, "smooth");
    s.outer_slope_fall_off_along_curve = ramp({0.0, 0.4, 0.5, 1.2, 1.0, 0.5});
    s.inner_slope_fall_off_along_curve = ramp({0.0, 1.0, 1.0, 0.3});
    s.inner_slope_shape = ramp({0.0, 1.0, 0.4, 0.5, 1.0, 0.0});
    s.boundary_noise = 2.0;
    s.boundary_noise_length = 6.0;
    s.crest_push = ramp({0.0, 0.0, 0.5, 2.0, 1.0, 0.0}, "smooth");
    s.crest_pinch = ramp({0.0, 0.0, 0.5, 0.6, 1.0, 0.0});
    s.max_dist = 9.0;
    s.seed = 7;
    return s;
}

Vec2d random_in(const DuneShape& dune, uint64_t i) {
    const Vec2d size = dune.upper() - dune.lower();
    return dune.lower() + Vec2d(size.x() * unit_double(hash(i, 1)), size.y() * unit_double(hash(i, 2)));
}
// A point near the crest, at a log-uniform distance from 1e-4 m to 10 m.
Vec2d random_near(const Points& crest, uint64_t i) {
    const size_t k = 1 + size_t(double(crest.size() - 1) * unit_double(hash(i, 3)));
    const Vec2d at = crest[k - 1] + unit_double(hash(i, 4)) * (crest[k] - crest[k - 1]);
    const double a = 2.0 * pi * unit_double(hash(i, 5)),
                 r = std::pow(10.0, -4.0 + 5.0 * unit_double(hash(i, 6)));
    return at + r * Vec2d(std::cos(a), std::sin(a));
}

struct Case {
    const char* name;
    Points points;
    bool closed;
    DuneSettings settings;
};
std::vector<Case> cases() {
    DuneSettings angle = rich(), flipped = rich(), sharp = plain(), coarse = plain();
    angle.inner_slope_angle = 33.0 * degree;
    flipped.flip = true, flipped.max_dist = 0.0;
    flipped.main_curve_shape = ramp({0.0, 0.2, 0.37, 1.0, 0.8, 0.5, 1.0, 0.2}, "smooth"); // closed: no seam
    DuneSettings rounded = angle, stretched = angle, narrow = rich();
    rounded.crest_radius = 0.7;
    stretched.outer_slope_stretch = 2.5, stretched.outer_slope_turn = 0.4, stretched.crest_radius = 0.3;
    stretched.max_dist = 0.0;
    narrow.outer_slope_stretch = 6.0, narrow.outer_slope_turn = -1.2;
    sharp.smoothing = 0.0;
    sharp.main_curve_shape = ramp({0.0, 0.5, 0.33, 1.0, 1.0, 0.5});
    coarse.search_accuracy = 2.0;
    return {{"line", line, false, plain()},
            {"arc", arc(), false, rich()},
            {"arc, angle", arc(), false, angle},
            {"V", sharp_v, false, sharp},
            {"eight", figure_of_eight(), true, flipped},
            {"spiral", spiral(), false, rich()},
            {"circle", circle(30.0, 60), true, plain()},
            {"coarse", arc(), false, coarse},
            {"rounded", arc(), false, rounded},
            {"stretched", arc(), false, stretched},
            {"narrow", spiral(), false, narrow}};
}

TEST(DuneShape, AgreesWithQuadratureOfItsPage) {
    for (const Case& c : cases()) {
        const DuneShape dune(c.points, c.closed, c.settings);
        const Quadrature reference(dune, c.settings);
        const Points crest = dune.crest();
        double worst = 0.0, mask = 0.0, dist = 0.0, direction = 0.0;
        int in = 0;
        for (uint64_t i = 0; i < 400; ++i) {
            const Vec2d p = i % 2 ? random_near(crest, i) : random_in(dune, i);
            const DuneSample got = dune.sample(p), want = reference.at(p);
            worst = std::max(worst, std::abs(got.height - want.height) / c.settings.max_height);
            mask = std::max(mask, std::abs(got.mask - want.mask));
            if (got.height == 0.0 && got.mask == 0.0) continue;
            ++in;
            dist = std::max(dist, std::abs(got.dist - want.dist));
            if (got.dist > 0.01) direction = std::max(direction, (got.sample_dir - want.sample_dir).norm());
        }
        std::printf(
            "%-12s %4zu segments, %3d of 400 inside: height %.1e of max_height, mask %.1e, dist %.1e m, "
            "direction %.1e\n",
            c.name, crest.size() - 1, in, worst, mask, dist, direction);
        EXPECT_GT(in, 150) << c.name;
        EXPECT_LT(worst, 1e-5) << c.name;
        EXPECT_LT(mask, 1e-5) << c.name;
        EXPECT_LT(dist, 1e-5) << c.name;
        EXPECT_LT(direction, 1e-5) << c.name;
    }
}

// 1,000 segments of a winding curve, so that most of the curve is in the far field.
TEST(DuneShape, FarFieldIsWithinItsBound) {
    Points points;
    for (int i = 0; i < 800; ++i) points.emplace_back(2.0 * i, 60.0 * std::sin(0.05 * i));
    DuneSettings s = plain();
    s.main_curve_shape = ramp({0.0, 0.0, 0.1, 1.0, 0.2, 0.0, 0.3, 1.0, 0.31, 0.0, 1.0, 1.0}, "smooth");
    s.outer_slope_mult = 1.0;
    const DuneShape dune(points, false, s);
    const Quadrature reference(dune, s);
    const Points crest = dune.crest();
    EXPECT_GT(crest.size(), 1000U);
    double worst = 0.0, dist = 0.0;
    for (uint64_t i = 0; i < 150; ++i) {
        const Vec2d p = random_near(crest, i % 2 ? i : i + 1000) + (i % 2 ? 8.0 : 0.0) * Vec2d(0.3, 0.9);
        const DuneSample got = dune.sample(p), want = reference.at(p);
        worst = std::max(worst, std::abs(got.height - want.height) / s.max_height);
        if (got.height > 0.0) dist = std::max(dist, std::abs(got.dist - want.dist) / dune.reach());
    }
    std::printf("far field: %.1e of max_height, %.1e of reach\n", worst, dist);
    // The documented bounds are 1e-5. Dropping the far field would cause errors of about 1e-6 in distance and
    // in height.
    EXPECT_LT(worst, 1e-8);
    EXPECT_LT(dist, 1e-8);
}

// Compares the height along the crest, at least two slope widths from its ends, with the ramp.
TEST(DuneShape, CrestFollowsTheRamp) {
    DuneSettings s = plain();
    const double length = 240.0, spacing = s.slope_width / s.search_accuracy, feature = spacing / length;
    const Ramp ramps[] = {ramp({0.0, 0.0, 0.5, 1.0, 1.0, 0.0}, "smooth"),
                          ramp({0.0, 0.3, 0.37, 1.0, 1.0, 0.3}),
                          ramp({0.4, 0.5, 0.4 + feature, 1.0, 0.4 + 2.0 * feature, 0.5, 0.6, 0.8}),
                          ramp({0.4, 0.5, 0.4 + feature, 1.0, 0.4 + 2.0 * feature, 0.5, 0.6, 0.8}, "smooth")};
    for (const Ramp& shape : ramps) {
        s.main_curve_shape = shape;
        const DuneShape dune(Points{{0.0, 5.0}, {length, 5.0}}, false, s);
        double worst = 0.0;
        for (double x = 2.0 * s.slope_width; x < length - 2.0 * s.slope_width; x += 0.0473)
            worst =
                std::max(worst, std::abs(dune.sample({x, 5.0}).height - s.max_height * shape(x / length)));
        std::printf("crest: off the ramp by %.4f %% of max_height\n", 100.0 * worst / s.max_height);
        EXPECT_LT(worst, 1e-3 * s.max_height);
    }
}

// The same on bent curves: no dips between the points of the resampled curve.
TEST(DuneShape, CrestOfACurveHasNoBeads) {
    DuneSettings s = plain();
    s.main_curve_shape = Ramp();
    for (const bool closed : {false, true}) {
        const DuneShape dune(closed ? circle(30.0, 60) : arc(), closed, s);
        const Points crest = dune.crest();
        double worst = 0.0;
        const size_t skip = closed ? 0 : 2;
        for (size_t i = 1 + skip; i + skip < crest.size(); ++i)
            for (double t = 0.0; t < 1.0; t += 0.05) {
                const Vec2d p = crest[i - 1] + t * (crest[i] - crest[i - 1]);
                worst = std::max(worst, std::abs(dune.sample(p).height - s.max_height));
            }
        std::printf("crest of a curve: off by %.4f %%\n", 100.0 * worst / s.max_height);
        EXPECT_LT(worst, 1e-3 * s.max_height);
    }
}

TEST(DuneShape, IsSymmetricForSymmetricSettings) {
    DuneSettings s = plain();
    s.inner_slope_mult = 1.0;
    const DuneShape dune(line, false, s);
    double worst = 0.0;
    for (uint64_t i = 0; i < 1000; ++i) {
        const Vec2d p = random_in(dune, i);
        const double h = dune.sample(p).height;
        for (const Vec2d& q : {Vec2d(p.x(), -p.y()), Vec2d(-p.x(), p.y()), Vec2d(-p.x(), -p.y())})
            worst = std::max(worst, std::abs(dune.sample(q).height - h));
    }
    std::printf("mirrored: %.1e m\n", worst);
    EXPECT_LT(worst, 1e-9);
}

TEST(DuneShape, FlipSwapsTheSides) {
    DuneSettings s = plain();
    const DuneShape dune(line, false, s);
    // Seen from above with x to the right and z down the page, the left of a walk along +x is -z. The outer,
    // wider slope is there.
    EXPECT_GT(dune.sample({0.0, -10.0}).height, 0.0);
    EXPECT_EQ(dune.sample({0.0, 10.0}).height, 0.0);
    EXPECT_DOUBLE_EQ(dune.sample({0.0, -5.0}).outer, 1.0);
    EXPECT_DOUBLE_EQ(dune.sample({0.0, 5.0}).inner, 1.0);
    EXPECT_NEAR((dune.sample({0.0, -5.0}).sample_dir - Vec2d(0.0, 1.0)).norm(), 0.0, 1e-9);
    s.flip = true;
    const DuneShape flipped(line, false, s);
    for (uint64_t i = 0; i < 200; ++i) {
        const Vec2d p = random_in(dune, i);
        EXPECT_NEAR(flipped.sample({p.x(), -p.y()}).height, dune.sample(p).height, 1e-12);
    }
}

// Maximum slope and second difference along a path in steps of h. Second differences are taken only where the
// distance to the crest is above `clear_of_crest`.
struct Steepest {
    double slope = 0.0, bend = 0.0;
};
Steepest steepest(const DuneShape& dune, const Vec2d& from, const Vec2d& to, double h,
                  double clear_of_crest) {
    Steepest most;
    const auto n = int((to - from).norm() / h);
    const Vec2d step = (to - from).normalized() * h;
    double before[2] = {}, dist = 0.0;
    for (int i = 0; i <= n; ++i) {
        const DuneSample s = dune.sample(from + i * step);
        if (i >= 1) most.slope = std::max(most.slope, std::abs(s.height - before[0]) / h);
        if (i >= 2 && dist > clear_of_crest)
            most.bend = std::max(most.bend, std::abs(s.height - 2.0 * before[0] + before[1]) / (h * h));
        before[1] = before[0], before[0] = s.height, dist = s.dist;
    }
    return most;
}

TEST(DuneShape, HasNoStepAndNoCrease) {
    DuneSettings s = plain(), sharp = plain(), level = plain(), unlike = plain(), stretched = plain();
    stretched.outer_slope_stretch = 3.0, stretched.flip = true;
    stretched.outer_slope_mult = 2.0;
    unlike.main_curve_shape = ramp({0.0, 0.3, 1.0, 0.8});
    s.main_curve_shape = ramp({0.0, 0.6, 0.5, 1.0, 1.0, 0.6}, "smooth");
    sharp.smoothing = 0.0, level.main_curve_shape = Ramp();
    sharp.main_curve_shape = Ramp();
    struct Path {
        const char* name;
        DuneShape dune;
        Vec2d from, to;
    };
    const Path paths[] = {
        {"past an end", DuneShape(line, false, s), {44.0, -14.0}, {44.0, 11.0}},
        {"along the extension", DuneShape(line, false, s), {30.0, 0.7}, {55.0, 0.71}},
        {"oblique at an end", DuneShape(line, false, s), {50.0, -7.0}, {33.0, 6.0}},
        {"into a V", DuneShape(sharp_v, false, sharp), {-31.0, 0.3}, {14.0, -0.2}},
        {"across a V", DuneShape(sharp_v, false, sharp), {-6.0, -16.0}, {-5.0, 16.0}},
        {"crossing", DuneShape(figure_of_eight(), true, level), {-12.0, -9.0}, {12.5, 9.3}},
        {"beside a crossing", DuneShape(figure_of_eight(), true, level), {-12.0, 1.1}, {12.5, 1.4}},
        {"spiral", DuneShape(spiral(), false, s), {-30.0, 0.5}, {30.0, -0.7}},
        {"circle", DuneShape(circle(9.0, 60), true, level), {-25.0, 0.2}, {25.0, 0.1}},
        {"seam of unlike ends", DuneShape(circle(20.0, 60), true, unlike), {20.3, -9.0}, {20.2, 9.0}},
        {"past a stretched end", DuneShape(arc(), false, stretched), {14.0, -6.0}, {15.5, 16.0}},
        {"beside a stretched", DuneShape(arc(), false, stretched), {-22.0, 3.0}, {22.0, 8.0}},
        {"seam of a circle", DuneShape(circle(20.0, 60), true, s), {23.0, -9.0}, {23.2, 9.0}},
    };
    for (const Path& p : paths) {
        const Steepest coarse = steepest(p.dune, p.from, p.to, 1e-2, 0.25);
        const Steepest fine = steepest(p.dune, p.from, p.to, 2.5e-3, 0.25);
        const Vec2d middle = 0.5 * (p.from + p.to), part = 5e-4 * (p.to - p.from);
        const Steepest finest = steepest(p.dune, middle - part, middle + part, 1e-5, infinity);
        std::printf("%-20s slope %.3f %.3f %.3f, bend %.3f %.3f /m\n", p.name, coarse.slope, fine.slope,
                    finest.slope, coarse.bend, fine.bend);
        EXPECT_GT(coarse.slope, 0.05) << p.name; // the path crosses the dune
        EXPECT_LT(fine.slope, 1.1 * coarse.slope + 0.01) << p.name;
        EXPECT_LT(finest.slope, 1.1 * coarse.slope + 0.01) << p.name;
        EXPECT_LT(fine.bend, 1.2 * coarse.bend + 0.05) << p.name; // at a crease it would be 4 times as large
        EXPECT_LT(coarse.slope, 2.0) << p.name;
    }
}

TEST(DuneShape, SlipFaceHasItsAngle) {
    DuneSettings s;
    s.main_curve_shape = ramp({0.0, 0.5, 0.5, 1.0, 1.0, 0.5}, "smooth");
    s.inner_slope_angle = 33.0 * degree;
    s.crest_pinch = ramp({0.0, 0.7});
    s.boundary_noise = 2.0;
    const DuneShape dune(Points{{-200.0, 0.0}, {200.0, 0.0}}, false, s);
    for (double z = 0.1; z < 4.4; z += 0.1) {
        const double slope = (dune.sample({0.0, z}).height - dune.sample({0.0, z + 0.05}).height) / 0.05;
        EXPECT_NEAR(std::atan(slope) / degree, 33.0, 0.02) << z;
    }
    EXPECT_NEAR(dune.sample({0.0, 0.0}).height, 3.0, 3e-3);
    EXPECT_EQ(dune.sample({0.0, 3.0 / std::tan(33.0 * degree) + 0.01}).height, 0.0);
}

TEST(DuneShape, CrestRadiusRoundsTheCrestAndKeepsItsHeight) {
    DuneSettings s;
    s.main_curve_shape = Ramp();
    s.inner_slope_angle = 33.0 * degree;
    s.outer_slope_shape = ramp({0.0, 1.0, 1.0, 0.0});
    const Points straight = {{-200.0, 0.0}, {200.0, 0.0}};
    const double tangent = std::tan(s.inner_slope_angle), foot = s.max_height / tangent;
    for (const double r : {0.0, 0.25, 1.0}) {
        s.crest_radius = r;
        const DuneShape dune(straight, false, s);
        EXPECT_NEAR(dune.sample({0.0, 0.0}).height, 3.0, 3e-3);
        for (double z = 0.1; z < foot - 0.1; z += 0.1) { // the slope follows the documented formula
            const double slope =
                (dune.sample({0.0, z - 1e-3}).height - dune.sample({0.0, z + 1e-3}).height) / 2e-3;
            EXPECT_NEAR(slope, tangent * z / std::hypot(z, r), 1e-3) << z;
        }
        for (const auto& [side, width] : {std::pair(1.0, foot), std::pair(-1.0, s.slope_width)}) {
            const double moved = std::sqrt(width * width + 2.0 * width * r);
            EXPECT_LE(moved, width + r);
            EXPECT_GT(dune.sample({0.0, side * (moved - 0.01)}).height, 0.0);
            EXPECT_EQ(dune.sample({0.0, side * (moved + 0.01)}).height, 0.0);
        }
        const auto height = [&](double z) { return dune.sample({0.0, z}).height; };
        double bend = 0.0;
        for (double z = -3.0; z < 3.0; z += 0.01)
            bend = std::max(bend, std::abs(height(z + 0.05) - 2.0 * height(z) + height(z - 0.05)) / 0.0025);
        std::printf("crest radius %.2f m: bend %.2f /m\n", r, bend);
        if (r > 0.0)
            EXPECT_LT(bend, 1.05 * tangent / r);
        else
            EXPECT_GT(bend, 10.0);
    }
}

TEST(DuneShape, OuterSlopeIsStretchedAlongTheAxis) {
    DuneSettings s;
    s.main_curve_shape = Ramp();
    s.outer_slope_stretch = 3.0;
    const Points straight = {{-200.0, 10.0}, {200.0, 10.0}};
    const auto foot = [&](const DuneShape& dune, double side) {
        double z = 0.0;
        while (dune.sample({0.0, 10.0 + side * z}).height > 0.0) z += 0.01;
        return z;
    };
    // Across a straight crest the stretch depends on the angle between axis and crest.
    for (const double turn : {0.0, 0.5, pi / 2.0}) {
        s.outer_slope_turn = turn;
        const DuneShape dune(straight, false, s);
        const double c = std::cos(turn), t = std::sin(turn), k = 3.0;
        // M = 1 + (k - 1) b b^T for b = (c, t); the distance of M P from the line of M (1, 0) is det M |P| /
        // |M (1, 0)|
        const double stretched = k / std::hypot(1.0 + (k - 1.0) * c * c, (k - 1.0) * c * t);
        EXPECT_NEAR(foot(dune, -1.0), 12.0 / stretched, 0.02);
        EXPECT_NEAR(foot(dune, 1.0), 7.2, 0.02); // the inner slope is unchanged
        const DuneSample beside = dune.sample({0.0, 10.0 - 2.0});
        EXPECT_NEAR(beside.dist, 2.0, 1e-3); // distance and direction are unchanged
        EXPECT_NEAR((beside.sample_dir - Vec2d(0.0, 1.0)).norm(), 0.0, 1e-6);
    }
    s.outer_slope_turn = 0.0;
    DuneSettings not_stretched = s;
    not_stretched.outer_slope_stretch = 1.0;
    const DuneShape ring(circle(20.0, 60), true, s), plain_ring(circle(20.0, 60), true, not_stretched);
    for (uint64_t i = 0; i < 100; ++i) { // a closed curve has no axis
        const Vec2d p = random_in(ring, i);
        EXPECT_EQ(ring.sample(p).height, plain_ring.sample(p).height);
    }
    Points turned; // the dune rotates with its curve
    for (const Vec2d& p : arc()) turned.emplace_back(Eigen::Rotation2Dd(0.7) * p);
    const DuneShape a(arc(), false, s), b(turned, false, s);
    for (uint64_t i = 0; i < 200; ++i) {
        const Vec2d p = random_in(a, i);
        EXPECT_NEAR(a.sample(p).height, b.sample(Eigen::Rotation2Dd(0.7) * p).height, 1e-9);
    }
}

TEST(DuneShape, DropsWhatIsNoCurve) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const DuneSettings s = plain();
    for (const Points& points : {Points{}, Points{{1.0, 2.0}}, Points{{1.0, 2.0}, {1.0, 2.0}, {1.0, 2.0}},
                                 Points{{nan, 0.0}, {1.0, 2.0}, {infinity, 3.0}}})
        for (const bool closed : {false, true}) {
            const DuneShape dune(points, closed, s);
            EXPECT_TRUE(dune.empty());
            EXPECT_TRUE(dune.crest().empty());
            EXPECT_EQ(dune.sample({1.0, 2.0}).height, 0.0);
            double height[3] = {1.0, 1.0, 1.0}, mask[3] = {1.0, 1.0, 1.0};
            dune.row(0.0, 2.0, 1.0, 3, height, mask);
            EXPECT_EQ(height[1], 0.0);
            EXPECT_EQ(mask[2], 0.0);
        }
    const DuneShape clean(arc(), false, s);
    Points dirty;
    for (const Vec2d& p : arc())
        dirty.insert(dirty.end(), {p, p, Vec2d(nan, p.y()), Vec2d(p.x(), -infinity), p});
    const DuneShape cleaned(dirty, false, s);
    ASSERT_EQ(clean.crest().size(), cleaned.crest().size());
    for (uint64_t i = 0; i < 100; ++i)
        EXPECT_EQ(clean.sample(random_in(clean, i)).height, cleaned.sample(random_in(clean, i)).height);
    Points joined = circle(20.0, 50);
    const DuneShape open(joined, true, s);
    joined.push_back(joined.front());
    EXPECT_EQ(DuneShape(joined, true, s).crest(), open.crest());
    const DuneShape there_and_back(line, true, s), once(line, false, s);
    EXPECT_EQ(there_and_back.sample({3.0, 2.0}).height, once.sample({3.0, 2.0}).height);
    EXPECT_FALSE(once.sample({nan, 0.0}).height > 0.0);
}

TEST(DuneShape, KeepsEndsAndCorners) {
    DuneSettings s = plain();
    const DuneShape smoothed(arc(), false, s);
    EXPECT_NEAR((smoothed.crest().front() - arc().front()).norm(), 0.0, 1e-9);
    EXPECT_NEAR((smoothed.crest().back() - arc().back()).norm(), 0.0, 1e-9);
    s.smoothing = 0.0;
    const Points corner = DuneShape(sharp_v, false, s).crest();
    double nearest = 1.0;
    for (const Vec2d& p : corner) nearest = std::min(nearest, p.norm());
    EXPECT_LT(nearest, 1e-9);
    s.smoothing = 0.3;
    for (const Vec2d& p : DuneShape(sharp_v, false, s).crest()) EXPECT_GT(p.norm(), 0.5);
    // The crest is pushed to the inner side (+z here), not along the curve.
    s.crest_push = ramp({0.0, 0.0, 0.5, 4.0, 1.0, 0.0}, "smooth");
    double top = 0.0;
    for (const Vec2d& p : DuneShape(line, false, s).crest()) {
        EXPECT_GE(p.y(), -1e-9);
        top = std::max(top, p.y());
    }
    EXPECT_NEAR(top, 4.0, 0.1);
}

TEST(DuneShape, IsNothingOutsideOfItsBox) {
    double spare = 0.0;
    for (const Case& c : cases()) {
        const DuneShape dune(c.points, c.closed, c.settings);
        const Quadrature reference(dune, c.settings);
        const Vec2d size = dune.upper() - dune.lower();
        for (uint64_t i = 0; i < 160; ++i) { // just outside, by the formulas, which use no box
            Vec2d p = random_in(dune, i);
            const double off = 1e-6 + 2.0 * unit_double(hash(i, 9));
            if (i % 4 == 0) p.x() = dune.upper().x() + off;
            if (i % 4 == 1) p.x() = dune.lower().x() - off;
            if (i % 4 == 2) p.y() = dune.upper().y() + off;
            if (i % 4 == 3) p.y() = dune.lower().y() - off;
            const DuneSample s = reference.at(p);
            EXPECT_EQ(s.height, 0.0) << c.name;
            EXPECT_EQ(s.mask, 0.0) << c.name;
        }
        // The tightest box around the nonzero samples of the rows
        Vec2d low(infinity, infinity), high = -low;
        std::vector<double> height(200), mask(200);
        for (int j = 0; j < 200; ++j) {
            const double z = dune.lower().y() + size.y() * j / 199.0;
            dune.row(dune.lower().x(), z, size.x() / 199.0, 200, height.data(), mask.data());
            for (int i = 0; i < 200; ++i)
                if (height[size_t(i)] != 0.0 || mask[size_t(i)] != 0.0) {
                    const Vec2d p(dune.lower().x() + size.x() * i / 199.0, z);
                    low = low.cwiseMin(p), high = high.cwiseMax(p);
                }
        }
        const Vec2d tight = high - low;
        std::printf("box of %-12s %.0f x %.0f m, needed %.0f x %.0f m\n", c.name, size.x(), size.y(),
                    tight.x(), tight.y());
        spare = std::max(spare, size.prod() / tight.prod());
    }
    EXPECT_LT(spare, 1.7);
}

TEST(DuneShape, RowsHaveTheBitsOfSamples) {
    for (const Case& c : cases()) {
        const DuneShape dune(c.points, c.closed, c.settings);
        const double x = dune.lower().x() - 3.0, cell = (dune.upper().x() - dune.lower().x() + 6.0) / 150.0;
        std::vector<double> height(150), mask(150);
        std::vector<DuneSample> all(150);
        for (int j = 0; j < 12; ++j) {
            const double z = dune.lower().y() + (dune.upper().y() - dune.lower().y()) * (j - 0.5) / 10.5;
            const int count = 139 + j;
            dune.row(x, z, cell, count, height.data(), mask.data());
            dune.row(x, z, cell, count, all.data());
            for (int i = 0; i < count; ++i) {
                const DuneSample s = dune.sample({x + i * cell, z});
                const DuneSample& r = all[size_t(i)];
                ASSERT_EQ(s.height, height[size_t(i)]) << c.name;
                ASSERT_EQ(s.mask, mask[size_t(i)]) << c.name;
                ASSERT_TRUE(s.height == r.height && s.mask == r.mask && s.outer == r.outer &&
                            s.inner == r.inner && s.dist == r.dist && s.sample_dir == r.sample_dir)
                    << c.name << ' ' << i;
            }
        }
    }
}

TEST(DuneShape, NoiseIsBoundedAndPeriodic) {
    DuneSettings s = plain();
    s.boundary_noise = 3.0;
    s.boundary_noise_length = 4.0;
    s.inner_slope_mult = 1.0;
    for (uint64_t seed = 0; seed < 20; ++seed) {
        s.seed = seed;
        double low = infinity, high = -infinity, apart = 0.0, step = 0.0;
        const auto points = DuneShape(circle(40.0, 100), true, s).crest_points();
        for (size_t i = 0; i < points.size(); ++i) {
            low = std::min({low, points[i].outer_width, points[i].inner_width});
            high = std::max({high, points[i].outer_width, points[i].inner_width});
            apart = std::max(apart, std::abs(points[i].outer_width - points[i].inner_width));
            if (i > 0) step = std::max(step, std::abs(points[i].outer_width - points[i - 1].outer_width));
        }
        EXPECT_GE(low, 9.0);
        EXPECT_LE(high, 15.0);
        EXPECT_GT(high - low, 2.0);
        EXPECT_GT(apart, 1.0); // each side has its own noise
        EXPECT_LT(step, 3.6);  // 1.5 m in a lattice cell of 4 m: at most 1.5 * 6 m * 1.5 / 4
        EXPECT_EQ(points.front().outer_width, points.back().outer_width);
    }
}

TEST(DuneShape, DigestKnowsEverySetting) {
    const Points points = arc();
    const uint64_t digest = DuneShape(points, false, DuneSettings{}).digest();
    EXPECT_EQ(digest, DuneShape(points, false, DuneSettings{}).digest());
    EXPECT_NE(digest, DuneShape(points, true, DuneSettings{}).digest());
    Points moved = points;
    moved[3].y() += 1e-9;
    EXPECT_NE(digest, DuneShape(moved, false, DuneSettings{}).digest());
    using S = DuneSettings;
    for (double S::*number :
         {&S::max_height, &S::slope_width, &S::outer_slope_mult, &S::inner_slope_mult, &S::inner_slope_angle,
          &S::boundary_noise, &S::boundary_noise_length, &S::max_dist, &S::smoothing, &S::search_accuracy,
          &S::outer_slope_stretch, &S::outer_slope_turn, &S::crest_radius}) {
        S s;
        s.*number += 0.125;
        EXPECT_NE(digest, DuneShape(points, false, s).digest());
    }
    for (Ramp S::*shape :
         {&S::main_curve_shape, &S::outer_slope_fall_off_along_curve, &S::inner_slope_fall_off_along_curve,
          &S::outer_slope_shape, &S::inner_slope_shape, &S::mask_fall_off, &S::crest_push, &S::crest_pinch}) {
        S s;
        s.*shape = ramp({0.0, 0.77});
        EXPECT_NE(digest, DuneShape(points, false, s).digest());
    }
    S s;
    s.flip = true;
    EXPECT_NE(digest, DuneShape(points, false, s).digest());
    s = {}, s.seed = 1;
    EXPECT_NE(digest, DuneShape(points, false, s).digest());
    s = {}, s.outer_slope_shape = ramp({0.0, 1.0, 1.0, 0.0}, "linear");
    EXPECT_NE(digest, DuneShape(points, false, s).digest());
}

TEST(DuneShape, IsFiniteForAnyParameters) {
    using S = DuneSettings;
    const double values[] = {0.0, -1.0, 1e-300, 1e-3, 1.0, 1e5, 1e300, -1e300};
    const auto pick = [&](uint64_t i, uint64_t what) { return values[hash(i, what) % std::size(values)]; };
    int inside = 0;
    for (uint64_t i = 0; i < 150; ++i) {
        S s;
        uint64_t what = 0;
        for (double S::*number : {&S::max_height, &S::slope_width, &S::outer_slope_mult, &S::inner_slope_mult,
                                  &S::inner_slope_angle, &S::boundary_noise, &S::boundary_noise_length,
                                  &S::max_dist, &S::smoothing, &S::search_accuracy, &S::outer_slope_stretch,
                                  &S::outer_slope_turn, &S::crest_radius})
            if (hash(i, ++what) % 4 == 0) s.*number = pick(i, what + 100);
        for (Ramp S::*shape : {&S::main_curve_shape, &S::outer_slope_fall_off_along_curve,
                               &S::inner_slope_fall_off_along_curve, &S::outer_slope_shape,
                               &S::inner_slope_shape, &S::mask_fall_off, &S::crest_push, &S::crest_pinch})
            if (hash(i, ++what) % 4 == 0)
                s.*shape = ramp({0.0, pick(i, what + 200), 0.5, pick(i, what + 300)},
                                what % 2 ? "smooth" : "linear");
        const Points base = i % 3 == 0 ? arc() : i % 3 == 1 ? circle(10.0, 20) : sharp_v;
        Points points = base;
        const double scale = i % 5 == 0 ? 1e6 : i % 5 == 1 ? 1e-3 : 1.0;
        for (Vec2d& p : points) p *= scale;
        const DuneShape dune(points, i % 2 == 0, s);
        ASSERT_TRUE(dune.lower().allFinite() && dune.upper().allFinite()) << i;
        const auto crest = dune.crest_points();
        for (uint64_t k = 0; k < 60 && !dune.empty(); ++k) {
            const auto& on = crest[hash(k, i) % crest.size()];
            const Vec2d p = k % 3 == 0   ? on.at
                            : k % 3 == 1 ? random_in(dune, k)
                                         : Vec2d(on.at * (1.0 + 1e-9 * double(k)));
            const DuneSample r = dune.sample(p);
            inside += r.height > 0.0;
            ASSERT_TRUE(std::isfinite(r.height) && std::isfinite(r.mask) && std::isfinite(r.outer) &&
                        std::isfinite(r.inner) && std::isfinite(r.dist) && r.sample_dir.allFinite())
                << i << ' ' << k;
            ASSERT_TRUE(r.mask >= 0.0 && r.mask <= 1.0);
        }
        if (dune.empty()) continue;
        double height[20], mask[20];
        for (const double x : {-1e300, -1e9, 0.0}) {
            dune.row(x, crest[0].at.y(), x == 0.0 ? 1e299 : -x / 10.0, 20, height, mask);
            for (int k = 0; k < 20; ++k) ASSERT_TRUE(std::isfinite(height[k]) && std::isfinite(mask[k]));
        }
    }
    EXPECT_GT(inside, 500);
}

TEST(DuneShape, TakesAHundredThousandPoints) {
    Points points;
    for (int i = 0; i < 100000; ++i)
        points.emplace_back(0.02 * i + 0.01 * unit_double(hash(1, uint64_t(i))),
                            80.0 * std::sin(0.0003 * i) + 0.01 * unit_double(hash(2, uint64_t(i))));
    for (const double smoothing : {0.0, 0.2}) {
        DuneSettings s = plain();
        s.smoothing = smoothing;
        const auto start = std::chrono::steady_clock::now();
        const DuneShape dune(points, false, s);
        const double ms =
            1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const size_t segments = dune.crest().size() - 1;
        std::printf("100,000 points: %zu segments in %.1f ms\n", segments, ms);
        EXPECT_GT(segments, 1000U);
        EXPECT_LE(segments, 4096U);
        EXPECT_GT(dune.sample(points[50000]).height, 2.9);
    }
}

// Both desert sizes from the documentation: timings are printed, and the bits are compared on one and two
// threads.
double raise(const std::vector<DuneShape>& dunes, double cell, int columns, int rows, int threads,
             std::vector<double>& heights) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    const auto samples = size_t(columns) * size_t(rows);
    heights.assign(dunes.size() * samples, 0.0);
    std::vector<double> masks(heights.size());
    const auto start = std::chrono::steady_clock::now();
    tbb::parallel_for(size_t(0), dunes.size() * size_t(rows), [&](size_t k) {
        const DuneShape& dune = dunes[k / size_t(rows)];
        const double z = dune.lower().y() + cell * double(k % size_t(rows));
        dune.row(dune.lower().x(), z, cell, columns, &heights[k * size_t(columns)],
                 &masks[k * size_t(columns)]);
    });
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

TEST(DuneShape, HasTheSameBitsOnAnyNumberOfThreads) {
    DuneSettings s = plain();
    std::vector<DuneShape> many;
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < 250; ++i) {
        Points points = arc();
        s.seed = uint64_t(i);
        s.boundary_noise = 1.0;
        s.search_accuracy = 5.0;
        many.emplace_back(points, false, s);
    }
    const double built = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::printf("250 dunes of %zu segments built in %.1f ms\n", many[0].crest().size() - 1, 1e3 * built);
    Points winding;
    for (int i = 0; i < 300; ++i) winding.emplace_back(2.0 * i, 40.0 * std::sin(0.03 * i));
    const std::vector<DuneShape> one(1, DuneShape(winding, false, plain()));
    struct Size {
        const char* name;
        const std::vector<DuneShape>& dunes;
        int columns, rows;
    };
    for (const Size& size : {Size{"250 dunes", many, 64, 64}, Size{"one curve", one, 1000, 250}}) {
        const Vec2d box = size.dunes[0].upper() - size.dunes[0].lower();
        const double cell = std::max(box.x() / size.columns, box.y() / size.rows);
        std::vector<double> first, second;
        const double one_thread = raise(size.dunes, cell, size.columns, size.rows, 1, first);
        const double two_threads = raise(size.dunes, cell, size.columns, size.rows, 2, second);
        const double segments = double(size.dunes[0].crest().size() - 1);
        std::printf(
            "%s, %.0f segments, %zu samples: %.0f ns a sample (%.2f a segment) on one thread, %.0f on two\n",
            size.name, segments, first.size(), 1e9 * one_thread / double(first.size()),
            1e9 * one_thread / double(first.size()) / segments, 1e9 * two_threads / double(first.size()));
        EXPECT_EQ(std::memcmp(first.data(), second.data(), first.size() * sizeof(double)), 0);
        EXPECT_GT(*std::max_element(first.begin(), first.end()), 2.5);
    }
}

} // namespace
} // namespace marram
