// SPDX-License-Identifier: Apache-2.0
// Compares gusts with the definition in gusts.h, evaluated independently, gust by gust and point by point in
// double precision. Also checks invariants for any parameters: gusts never pop, the result does not depend on
// how strands are grouped into patches, and only gusts that overlap a patch are evaluated there.
#include "procedural/wind/gusts.h"
#include "procedural/wind/wind.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <deque>

using namespace marram;

namespace {

using Points = std::vector<Vec3d>;
constexpr int test_cvs = 4;

// Points as CVs of strands of four, rounded to float as the CVs of strands are.
Strands strands_at(Points& points) {
    Strands strands;
    while (points.size() % test_cvs != 0) points.push_back(points.back());
    const auto count = int(points.size()) / test_cvs;
    strands.resize(count, test_cvs, false);
    for (int i = 0; i < strands.blocks * lanes; ++i)
        for (int k = 0; k < test_cvs; ++k) {
            Vec3d& p = points[size_t(std::min(i, count - 1)) * test_cvs + size_t(k)];
            p = p.cast<float>().cast<double>();
            Wide3f& cv = strands.rest[size_t(i / lanes) * test_cvs + size_t(k)];
            cv.x[i % lanes] = float(p.x());
            cv.y[i % lanes] = float(p.y());
            cv.z[i % lanes] = float(p.z());
        }
    return strands;
}

float gust_of(const Strands& strands, size_t point) {
    const size_t i = point / test_cvs, k = point % test_cvs;
    return strands.gust[i / lanes * test_cvs + k][int(i % lanes)];
}

constexpr double fps = 24.0;
const Vec3d wind = Vec3d(1.0, 0.15, -0.3).normalized();

std::vector<float> evaluate_gusts(const Gusts& gusts, Points& points, double frame,
                                  size_t* evaluated = nullptr, const Vec3d& w = wind) {
    Strands strands = strands_at(points);
    const size_t touching = add_gusts(gusts_at(gusts, w, frame, fps), strands);
    if (evaluated) *evaluated = touching;
    std::vector<float> values;
    for (size_t i = 0; i < points.size(); ++i) values.push_back(gust_of(strands, i));
    return values;
}

// ---- The definition ----

double lattice(uint32_t seed, int64_t i, int64_t j, int64_t k) {
    const uint32_t h = mix32(mix32(mix32(seed + uint32_t(i)) + uint32_t(j)) + uint32_t(k));
    return double(h >> 8) / 16777216.0;
}

double nu(const Vec3d& x, uint32_t seed) {
    const Vec3d base = x.array().floor();
    double sum = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1.0;
        int64_t cell[3];
        for (int axis = 0; axis < 3; ++axis) {
            const double f = x[axis] - base[axis];
            const double b = ((6.0 * f - 15.0) * f + 10.0) * f * f * f;
            const int high = corner >> axis & 1;
            weight *= high ? b : 1.0 - b;
            cell[axis] = int64_t(base[axis]) + high;
        }
        sum += weight * lattice(seed, cell[0], cell[1], cell[2]);
    }
    return sum;
}

double plain_gust(const Gusts& gusts, const Vec3d& w, int64_t repetition, uint32_t i, double frame,
                  const Vec3d& p) {
    const uint64_t key = hash(hash(gusts.seed, gusts.redraw ? uint64_t(repetition) : 0), i);
    const auto draw = [&](uint64_t purpose) { return unit_double(hash(key, purpose)); };
    const auto within = [&](uint64_t purpose, const Vec2d& r) {
        return r[0] + (r[1] - r[0]) * draw(purpose);
    };
    const double radius = within(2, gusts.radius), lumps = within(3, gusts.radius_noise);
    const double life = within(6, gusts.life), decay = within(7, gusts.decay);
    const double age = frame - within(5, gusts.start_frame) - double(repetition) * gusts.period;
    const double d = std::min(std::max(decay, 1.0), life);
    if (!(life > 0.0 && radius > 0.0 && age > -d && age < life)) return 0.0;
    const Vec3d a = (std::abs(w.y()) > 0.999 ? Vec3d(1, 0, 0) : Vec3d(0, 1, 0)).cross(w).normalized(),
                b = w.cross(a);
    const Vec3d center = *gusts.center - *gusts.distance * w + (draw(0) - 0.5) * (*gusts.extent)[0] * a +
                         (draw(1) - 0.5) * (*gusts.extent)[1] * b + w * (within(4, gusts.speed) * age / fps);
    const Vec3d x = (p - center) / radius;
    if (x.norm() >= 1.0) return 0.0;
    const double t = x.norm() / (1.0 - lumps * nu(1.5 * x, uint32_t(hash(key, 8) >> 32)));
    const auto s = [](double y) { return y >= 1.0 ? 1.0 : y * y * (3.0 - 2.0 * y); };
    return t < 1.0 ? gusts.strength * s((age + d) / d) * s((life - age) / d) * gusts.ramp(t) : 0.0;
}

double plain_control(const GustControl& control, double frame, const Vec3d& p) {
    const Vec3d x = control.transform.at(frame).inverse() * p;
    double t = x.norm();
    if (control.box) {
        t = 0.0;
        for (int axis = 0; axis < 3; ++axis)
            if (const double size = std::abs(x[axis]), inner = control.inner[axis]; size > inner)
                t = std::max(t, size < 1.0 ? (size - inner) / (1.0 - inner) : 1.0);
    }
    return t < 1.0 ? control.strength * control.ramp(t) : 0.0;
}

double plain_sum(const Gusts& gusts, double frame, const Vec3d& p) {
    double sum = 0.0;
    const double reach =
        gusts.life.maxCoeff() + gusts.start_frame.cwiseAbs().maxCoeff() + gusts.decay.maxCoeff() + 2.0;
    int64_t first = 0, last = 0;
    if (gusts.period > 0.0) {
        first = int64_t((frame - reach) / gusts.period) - 1;
        last = int64_t((frame + reach) / gusts.period) + 1;
    }
    for (int64_t m = first; m <= last; ++m)
        for (uint32_t i = 0; i < gusts.num_gusts; ++i) sum += plain_gust(gusts, wind, m, i, frame, p);
    for (const GustControl& control : gusts.controls) sum += plain_control(control, frame, p);
    return sum;
}

// ---- Scenes ----

Ramp ramp_of(std::vector<double> knots, const char* interpolation) {
    return {std::span<const double>(knots), interpolation};
}
Ramp fall() { return ramp_of({0, 1, 1, 0}, "smooth"); }

struct Random {
    uint64_t seed, count = 0;
    double unit() { return unit_double(hash(seed, count++)); }
    double in(double low, double high) { return low + (high - low) * unit(); }
    Vec3d vec(double size) { return {in(-size, size), in(-size, size), in(-size, size)}; }
};

Gusts some_gusts(uint64_t seed) {
    Random random{seed};
    Gusts gusts;
    gusts.num_gusts = 60;
    gusts.radius = {0.5, random.in(1.0, 4.0)};
    gusts.radius_noise = {0.0, random.in(0.0, 0.9)};
    gusts.speed = {1.0, random.in(2.0, 9.0)};
    gusts.start_frame = {random.in(-20.0, 0.0), random.in(50.0, 120.0)};
    gusts.life = {10.0, random.in(50.0, 150.0)};
    gusts.decay = {0.0, random.in(1.0, 60.0)};
    gusts.period = random.in(40.0, 120.0);
    gusts.redraw = seed % 2 == 1;
    gusts.strength = random.in(0.3, 1.5);
    gusts.ramp = seed % 3 == 0 ? ramp_of({0, 1, 0.3, 0.8, 1, 0}, "linear") : fall();
    gusts.seed = uint32_t(seed * 77);
    gusts.center = random.vec(2.0);
    gusts.extent = Vec2d(8.0, 4.0);
    gusts.distance = 5.0;
    return gusts;
}

GustControl some_control(Random& random) {
    GustControl control;
    control.box = random.unit() < 0.5;
    std::vector<double> keys;
    const int count = 1 + int(random.unit() * 3.0);
    for (int key = 0; key < count; ++key) {
        keys.push_back(10.0 * key + random.in(0.0, 5.0));
        for (int i = 0; i < 3; ++i) keys.push_back(random.in(-4.0, 4.0));
        for (int i = 0; i < 3; ++i) keys.push_back(random.in(-200.0, 200.0));
        for (int i = 0; i < 3; ++i) keys.push_back(random.in(0.3, 4.0) * (random.unit() < 0.2 ? -1.0 : 1.0));
    }
    if (count == 2) // the random controls with two keys: no scale passes through 0
        for (int i = 7; i < 10; ++i)
            keys[size_t(i) + 10] = std::copysign(keys[size_t(i) + 10], keys[size_t(i)]);
    control.transform = KeyedTransform(keys, random.unit() < 0.5 ? "linear" : "smooth");
    control.inner = {random.in(0.0, 0.9), random.in(0.0, 0.9), random.in(0.0, 0.9)};
    control.ramp = fall();
    control.strength = random.in(-1.0, 1.0);
    return control;
}

Points some_points(uint64_t seed, int count, double size) {
    Random random{seed};
    Points points;
    for (int i = 0; i < count; ++i) points.push_back(random.vec(size));
    return points;
}

// ---- Against the definition ----

TEST(Gusts, ProceduralOnesAreAsDefined) {
    double worst = 0.0;
    int felt = 0;
    for (const uint64_t seed : {1, 2, 3, 4, 5, 6}) {
        const Gusts gusts = some_gusts(seed);
        Points points = some_points(seed + 100, 200, 5.0);
        for (const double frame : {-1e4, -3.25, 0.0, 12.5, 97.0, 1e5}) {
            const auto values = evaluate_gusts(gusts, points, frame);
            for (size_t i = 0; i < points.size(); ++i) {
                const double expected = plain_sum(gusts, frame, points[i]);
                worst = std::max(worst, std::abs(double(values[i]) - expected));
                felt += expected > 0.0;
            }
        }
    }
    std::printf("seeds 1 ... 6: worst error %.2g, %d of 7200 points feel a gust\n", worst, felt);
    EXPECT_LT(worst, 1e-6);
    EXPECT_GT(felt, 1500);
}

TEST(Gusts, ControlsAreAsDefined) {
    double worst = 0.0;
    int felt = 0;
    for (const uint64_t seed : {11, 12, 13, 14}) {
        Random random{seed};
        Gusts gusts;
        for (int i = 0; i < 40; ++i) gusts.controls.push_back(some_control(random));
        Points points = some_points(seed, 400, 6.0);
        for (const double frame : {-10.0, 3.0, 7.7, 11.0, 100.0}) {
            const auto values = evaluate_gusts(gusts, points, frame);
            for (size_t i = 0; i < points.size(); ++i) {
                const double expected = plain_sum(gusts, frame, points[i]);
                worst = std::max(worst, std::abs(double(values[i]) - expected));
                felt += expected != 0.0;
            }
        }
    }
    std::printf("seeds 11 ... 14: worst error %.2g, %d of 8000 points feel a control\n", worst, felt);
    EXPECT_LT(worst, 1e-6);
    EXPECT_GT(felt, 4000);
}

// A gust with a known position at its start frame.
Gusts one_gust() {
    Gusts gusts;
    gusts.num_gusts = 1;
    gusts.radius = {2.0, 2.0};
    gusts.speed = {6.0, 6.0};
    gusts.life = {100.0, 100.0};
    gusts.decay = {20.0, 20.0};
    gusts.start_frame = {10.0, 10.0};
    gusts.center = Vec3d(1, 2, 3);
    gusts.extent = Vec2d(0, 0);
    gusts.distance = 5.0;
    gusts.ramp = fall();
    return gusts;
}

TEST(Gusts, AreWholeAtTheCentreAndNothingAtTheBoundary) {
    for (const double lumps : {0.0, 0.9}) {
        Gusts gusts = one_gust();
        gusts.radius_noise = {lumps, lumps};
        for (const double frame : {10.0, 40.0, 90.0}) {
            const Vec3d center = *gusts.center + (-5.0 + 6.0 * (frame - 10.0) / fps) * wind;
            Points points{center};
            for (int i = 0; i < 27; ++i)
                if (i != 13)
                    points.push_back(center + 2.0 * Vec3d(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1).normalized());
            const size_t count = points.size();
            const auto values = evaluate_gusts(gusts, points, frame);
            EXPECT_NEAR(values[0], 1.0F, 1e-5F) << frame;
            for (size_t i = 1; i < count; ++i) EXPECT_LT(values[i], 1e-6F);
        }
    }
}

TEST(Gusts, LumpsDentTheBallAndNeverLeaveIt) {
    Gusts gusts = one_gust();
    gusts.radius_noise = {0.6, 0.6};
    Points points;
    const Vec3d center = *gusts.center - 5.0 * wind;
    for (const Vec3d& direction : some_points(5, 1000, 1.0))
        points.push_back(center + 1.2 * direction.normalized());
    const auto values = evaluate_gusts(gusts, points, 10.0);
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    std::printf("radius 2, lumps 0.6: influence %.3f ... %.3f at distance 1.2, %.3f without lumps\n",
                double(*least), double(*most), fall()(0.6));
    EXPECT_LE(*most, float(fall()(0.6)) + 1e-6F);
    EXPECT_LT(*least, 0.5 * *most);
    for (const auto seed : {1U, 2U, 3U}) {
        double low = 1.0, high = 0.0;
        for (const Vec3d& x : some_points(seed, 20000, 20.0)) {
            low = std::min(low, nu(x, seed));
            high = std::max(high, nu(x, seed));
        }
        EXPECT_GE(low, 0.0);
        EXPECT_LT(high, 1.0);
        EXPECT_GT(high - low, 0.8);
    }
}

TEST(Gusts, FadeOverTheDecayAndSwellBeforeTheStart) {
    Gusts gusts = one_gust();
    gusts.speed = {0.0, 0.0};
    const Vec3d center = *gusts.center - 5.0 * wind;
    const auto at = [&](double frame) {
        Points points{center};
        return evaluate_gusts(gusts, points, frame)[0];
    };
    const auto expect = [&](std::vector<std::pair<double, double>> frames) {
        for (const auto& [frame, value] : frames) EXPECT_NEAR(at(frame), value, 1e-5) << frame;
    };
    expect({{-11, 0}, {-10, 0}, {0, 0.5}, {10, 1}, {50, 1}, {90, 1}, {100, 0.5}, {110, 0}, {500, 0}});
    gusts.decay = {1e6, 1e6}; // longer than the life: clamped to the life
    expect({{-90, 0}, {-40, 0.5}, {10, 1}, {60, 0.5}, {110, 0}});
    gusts.decay = {0.0, 0.0}; // shorter than a frame: clamped to one frame
    expect({{9, 0}, {9.5, 0.5}, {10, 1}, {109, 1}, {109.5, 0.5}, {110, 0}});
    gusts.life = {0.25, 0.25};
    expect({{9.74, 0}, {9.875, 0.5}, {10, 1}, {10.125, 0.5}, {10.25, 0}});
    gusts.life = {0.0, 0.0};
    expect({{9.999, 0}, {10, 0}, {10.001, 0}});
}

// ---- In time ----

// |dI/dframe| <= strength (ramp' |dt/dframe| + s'/d), where s' and the smooth ramp have a slope of at most
// 1.5, t = |x| / (1 - l nu) and |x| < 1: |dt| <= |dx| (1 / (1 - l) + l 1.5 |grad nu| / (1 - l)^2), |grad nu|
// <= sqrt(3) 1.875, |dx| = speed / (fps radius).
TEST(Gusts, NeverPop) {
    constexpr double slope = 1.5, grad = 1.7320508 * 1.875;
    for (const uint64_t seed : {21, 22, 23, 24, 25}) {
        Gusts gusts = some_gusts(seed);
        gusts.num_gusts = 6;
        gusts.distance = 0.0; // they start among the points
        gusts.extent = Vec2d(2.0, 2.0);
        gusts.ramp = fall();
        gusts.decay = {0.0, 3.0};
        Points points = some_points(seed, 64, 3.0);
        const double l = gusts.radius_noise.y(), dx = gusts.speed.y() / fps / gusts.radius.x();
        const double rate =
            slope * dx * (1.0 / (1.0 - l) + l * 1.5 * grad / ((1.0 - l) * (1.0 - l))) + slope / 1.0;
        const double alive = 6.0 * (std::ceil((gusts.life.y() + 3.0) / gusts.period) + 1.0);
        double changes[3] = {};
        const double steps[3] = {0.5, 0.05, 0.005};
        for (int s = 0; s < 3; ++s) {
            std::vector<float> before;
            for (int i = 0; i < 2000; ++i) {
                const auto now = evaluate_gusts(gusts, points, -30.0 + double(seed) + i * steps[s]);
                for (size_t k = 0; k < before.size(); ++k)
                    changes[s] = std::max(changes[s], std::abs(double(now[k]) - double(before[k])));
                before = now;
            }
            EXPECT_LE(changes[s], alive * gusts.strength * rate * steps[s] + 1e-6);
        }
        std::printf("seed %d: greatest change in 0.5, 0.05, 0.005 frames: %.3g %.3g %.3g\n", int(seed),
                    changes[0], changes[1], changes[2]);
        EXPECT_LT(changes[2], 0.03);
    }
}

TEST(Gusts, ComeAgainAfterEachPeriod) {
    for (const uint64_t seed : {31, 32, 33}) {
        Gusts gusts = some_gusts(seed);
        gusts.period = 50.0; // shorter than the lives: gusts of several repetitions overlap
        Points points = some_points(seed, 200, 5.0);
        for (const bool redraw : {false, true}) {
            gusts.redraw = redraw;
            const auto now = evaluate_gusts(gusts, points, 17.25);
            for (const double later : {50.0, -50.0, 1e6, -1e4}) {
                const auto then = evaluate_gusts(gusts, points, 17.25 + later);
                double difference = 0.0;
                for (size_t i = 0; i < points.size(); ++i)
                    difference = std::max(difference, std::abs(double(now[i]) - double(then[i])));
                if (redraw)
                    EXPECT_GT(difference, 0.01);
                else
                    EXPECT_LT(difference, 1e-6);
            }
        }
        double sum = 0.0; // there is wind at all times
        for (const double frame : {-1e4, 1e6})
            for (const float value : evaluate_gusts(gusts, points, frame)) sum += double(value);
        EXPECT_GT(sum, 1.0);
    }
}

TEST(Gusts, WithoutAPeriodComeOnce) {
    Gusts gusts = some_gusts(34);
    gusts.period = 0.0;
    Points points = some_points(34, 100, 5.0);
    const auto sum = [&](double frame) {
        double all = 0.0;
        for (const float value : evaluate_gusts(gusts, points, frame)) all += double(value);
        return all;
    };
    EXPECT_GT(sum(60.0), 0.0);
    for (const double frame : {-1e4, -300.0, 600.0, 1e6}) EXPECT_EQ(sum(frame), 0.0);
}

TEST(Gusts, KnowWhetherTheyMove) {
    Gusts gusts;
    EXPECT_FALSE(gusts_move(gusts));
    gusts.controls.resize(1);
    gusts.controls[0].transform = KeyedTransform(std::vector<double>{0, 1, 2, 3, 0, 0, 0, 1, 1, 1}, "linear");
    EXPECT_FALSE(gusts_move(gusts));
    gusts.controls[0].transform = KeyedTransform(
        std::vector<double>{0, 1, 2, 3, 0, 0, 0, 1, 1, 1, 9, 0, 0, 0, 0, 0, 0, 1, 1, 1}, "linear");
    EXPECT_TRUE(gusts_move(gusts));
    gusts.controls[0].strength = 0.0;
    EXPECT_FALSE(gusts_move(gusts));
    EXPECT_TRUE(gusts_move(one_gust()));
    gusts = one_gust();
    gusts.life = {0.0, 0.0};
    EXPECT_FALSE(gusts_move(gusts));
}

// ---- Patches ----

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST(Gusts, DoNotDependOnHowStrandsAreCutIntoPatches) {
    for (const uint64_t seed : {41, 42, 43}) {
        Gusts gusts = some_gusts(seed);
        gusts.num_gusts = 500;
        gusts.extent = Vec2d(60.0, 60.0);
        Random random{seed};
        for (int i = 0; i < 50; ++i) gusts.controls.push_back(some_control(random));
        Points all = some_points(seed, 4 * 64, 20.0); // large extent: overlaps nearly every gust
        size_t everything = 0;
        const auto values = evaluate_gusts(gusts, all, 33.0, &everything);
        size_t most = 0, least = everything;
        for (size_t i = 0; i < all.size(); i += test_cvs) { // one strand per patch
            for (int k = 1; k < test_cvs; ++k) all[i + size_t(k)] = all[i] + 0.1 * random.vec(1.0);
        }
        const auto together = evaluate_gusts(gusts, all, 33.0, &everything);
        for (size_t i = 0; i < all.size(); i += test_cvs) {
            Points strand(all.begin() + std::ptrdiff_t(i), all.begin() + std::ptrdiff_t(i + test_cvs));
            size_t touching = 0;
            const auto alone = evaluate_gusts(gusts, strand, 33.0, &touching);
            most = std::max(most, touching);
            least = std::min(least, touching);
            EXPECT_TRUE(same_bits(alone, {together.begin() + std::ptrdiff_t(i),
                                          together.begin() + std::ptrdiff_t(i + test_cvs)}));
        }
        std::printf("seed %d: %zu influences touch all strands, %zu ... %zu one of them\n", int(seed),
                    everything, least, most);
        EXPECT_LT(most, everything / 2);
    }
}

TEST(Gusts, CostAPatchWhatTouchesIt) {
    size_t before = 0;
    for (const uint32_t count : {100U, 1000U, 10000U, 100000U}) { // at equal density
        Gusts gusts = some_gusts(51);
        gusts.num_gusts = count;
        gusts.radius = {1.0, 2.0};
        gusts.extent = Vec2d(0.4 * count, 10.0);
        size_t evaluated = 0;
        for (int patch = 0; patch < 20; ++patch) {
            Points points = some_points(uint64_t(patch), 64, 0.5);
            for (Vec3d& p : points) p += Vec3d(0.0, 0.0, patch - 10.0);
            size_t touching = 0;
            evaluate_gusts(gusts, points, 60.0, &touching);
            evaluated += touching;
        }
        const size_t alive = gusts_at(gusts, wind, 60.0, fps).influences.size();
        std::printf("%6u gusts, %6zu alive: a patch evaluates %.2f\n", count, alive,
                    double(evaluated) / 20.0);
        if (count > 100U) {
            EXPECT_LE(evaluated, 2 * before + 20);
        }
        before = std::max(before, evaluated);
        EXPECT_LT(evaluated, 20U * 10U);
    }
}

TEST(Gusts, AreAddedToWhatIsThere) {
    const Gusts gusts = some_gusts(52);
    Points points = some_points(52, 64, 3.0);
    Strands strands = strands_at(points);
    const GustField field = gusts_at(gusts, wind, 60.0, fps);
    add_gusts(field, strands);
    const WideVector<VFloat> once = strands.gust;
    add_gusts(field, strands);
    for (size_t i = 0; i < once.size(); ++i)
        for (int lane = 0; lane < lanes; ++lane)
            EXPECT_EQ(strands.gust[i][lane], once[i][lane] + once[i][lane]);
}

// ---- Bounds of the scene ----

TEST(Gusts, StartOutsideTheSceneAndPassThroughIt) {
    for (const Vec3d& w : {Vec3d(1, 0, 0), Vec3d(0, -1, 0), Vec3d(-0.3, 0.2, 0.9), Vec3d(0.01, 1, 0)}) {
        const Vec3d direction = w.normalized(), lower(-10, 0, 4), upper(30, 2, 20);
        Gusts gusts = one_gust();
        gusts.center.reset();
        gusts.extent.reset();
        gusts.distance.reset();
        gusts.num_gusts = 500;
        gusts.start_frame = {0.0, 0.0};
        set_gust_plane(gusts, lower, upper, direction);
        Points points;
        for (int i = 0; i < 400; ++i) {
            Random random{uint64_t(i) + 60};
            points.emplace_back(random.in(-10, 30), random.in(0, 2), random.in(4, 20));
        }
        for (const float value : evaluate_gusts(gusts, points, 0.0, nullptr, direction))
            EXPECT_EQ(value, 0.0F);
        const double way = 2.0 * *gusts.distance;
        int felt = 0;
        gusts.life = {1e4, 1e4};
        std::vector<bool> has_felt(points.size());
        for (double frame = 0.0; frame < way / 6.0 * fps; frame += 4.0) {
            const auto values = evaluate_gusts(gusts, points, frame, nullptr, direction);
            for (size_t i = 0; i < values.size(); ++i) has_felt[i] = has_felt[i] || values[i] > 0.0F;
        }
        for (const bool f : has_felt) felt += f;
        EXPECT_GT(felt, 390) << direction.transpose();
        const auto after = evaluate_gusts(gusts, points, (way + 0.01) / 6.0 * fps, nullptr, direction);
        for (const float value : after) EXPECT_EQ(value, 0.0F);
    }
}

TEST(Gusts, KeepWhatTheSceneFixes) {
    Gusts gusts = one_gust();
    set_gust_plane(gusts, Vec3d(-9, -9, -9), Vec3d(5, 5, 5), Vec3d(1, 0, 0));
    EXPECT_EQ(*gusts.center, Vec3d(1, 2, 3));
    EXPECT_EQ(*gusts.extent, Vec2d(0, 0));
    EXPECT_EQ(*gusts.distance, 5.0);
    gusts.distance.reset(); // the plane stays upwind of the box although the center is off its middle
    set_gust_plane(gusts, Vec3d(-9, -9, -9), Vec3d(5, 5, 5), Vec3d(1, 0, 0));
    EXPECT_NEAR(gusts.center->x() - *gusts.distance, -9.0 - 2.0, 1e-12);
    const double inf = std::numeric_limits<double>::infinity();
    for (const Vec3d& empty : {Vec3d(inf, inf, inf), Vec3d(1, 1, 1), Vec3d(NAN, 0, 0)}) {
        Gusts lost = one_gust();
        lost.center.reset();
        lost.extent.reset();
        lost.distance.reset();
        set_gust_plane(lost, empty, -empty, Vec3d(1, 0, 0));
        EXPECT_EQ(*lost.center, Vec3d(0, 0, 0));
        EXPECT_EQ(*lost.extent, Vec2d(0, 0));
        EXPECT_EQ(*lost.distance, 2.0);
    }
}

// ---- Hard cases ----

void expect_finite(const char* name, const Gusts& gusts, double coordinates = 3.0,
                   const Vec3d& offset = Vec3d::Zero()) {
    double most = 0.0;
    for (const double frame : {-1e4, -1.0, 0.0, 10.0, 60.0, 1e6, 1e30, -1e30}) {
        Points points = some_points(7, 64, coordinates);
        for (Vec3d& p : points) p += offset;
        points.push_back(offset);
        for (const float value : evaluate_gusts(gusts, points, frame)) {
            EXPECT_TRUE(std::isfinite(value)) << name << " at " << frame;
            most = std::max(most, std::abs(double(value)));
        }
    }
    std::printf("%-28s greatest sum %.3g\n", name, most);
    EXPECT_LT(most, 1e6) << name;
}

TEST(Gusts, HardCasesStayFinite) {
    Gusts base = some_gusts(71);
    const auto with = [&](auto&& change) {
        Gusts gusts = base;
        change(gusts);
        return gusts;
    };
    expect_finite("radius 0", with([](Gusts& g) { g.radius = {0, 0}; }));
    expect_finite("radius 1e-320", with([](Gusts& g) {
                      g.radius = {1e-320, 1e-320}, g.extent = Vec2d(0, 0);
                  }));
    expect_finite("radius 1e-30", with([](Gusts& g) { g.radius = {1e-30, 1e-30}, g.extent = Vec2d(0, 0); }));
    expect_finite("radius 1e8", with([](Gusts& g) { g.radius = {1e8, 1e8}; }));
    expect_finite("radius 1e30", with([](Gusts& g) { g.radius = {1e30, 1e30}; }));
    expect_finite("life 0", with([](Gusts& g) { g.life = {0, 0}; }));
    expect_finite("life 1e-9", with([](Gusts& g) { g.life = {1e-9, 1e-9}; }));
    expect_finite("decay 0", with([](Gusts& g) { g.decay = {0, 0}; }));
    expect_finite("decay > life", with([](Gusts& g) { g.decay = {1e6, 1e6}; }));
    expect_finite("extent 0", with([](Gusts& g) { g.extent = Vec2d(0, 0); }));
    expect_finite("speed 0", with([](Gusts& g) { g.speed = {0, 0}; }));
    expect_finite("speed 1e9", with([](Gusts& g) { g.speed = {1e9, 1e9}; }));
    expect_finite("coordinates 1e7", with([](Gusts& g) { g.center = Vec3d(1e7, 1e7, 1e7); }), 3.0,
                  Vec3d(1e7, 1e7, 1e7));
    expect_finite("coordinates 1e18", with([](Gusts& g) { g.radius = {1e8, 1e8}; }), 1e18);
    expect_finite("coordinates 1e38", with([](Gusts& g) { g.radius = {1e-30, 1e30}; }), 1e38);
    expect_finite("one gust, no period", with([](Gusts& g) { g.num_gusts = 1, g.period = 0.0; }));
    base.num_gusts = 0;
    const auto control = [](bool box, std::vector<double> keys, const Vec3d& inner) {
        GustControl c;
        c.box = box;
        c.transform = KeyedTransform(keys, "linear");
        c.inner = inner;
        c.ramp = fall();
        return c;
    };
    for (const bool box : {false, true})
        for (const double size : {1e-320, 1e-300, 1e-30, 1e-6, 1.0, 1e6, 1e30, 1e150})
            for (const double inner : {0.0, 0.5, 1.0})
                for (const double other : {1.0, size})
                    base.controls.push_back(
                        control(box, {0, 0, 0, 0, 30, 40, 50, size, other, size}, Vec3d::Constant(inner)));
    expect_finite("controls of all sizes", base);
    expect_finite("controls far away", base, 1e30);
    // The scale passes through 0 at frame 10.
    base.controls = {
        control(true, {0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 20, 0, 0, 0, 0, 0, 0, -1, 1, 1}, {1, 1, 1})};
    expect_finite("scale through 0", base);
    Points centre{Vec3d::Zero()};
    EXPECT_EQ(evaluate_gusts(base, centre, 10.0)[0], 0.0F);
    EXPECT_EQ(evaluate_gusts(base, centre, 9.0)[0], 1.0F);
}

TEST(Gusts, OfABoxWhoseInnerIsItsOuterHaveAnEdge) {
    Gusts gusts;
    gusts.controls.resize(1);
    gusts.controls[0].box = true;
    gusts.controls[0].inner = Vec3d(1, 1, 1);
    gusts.controls[0].ramp = fall();
    gusts.controls[0].transform = KeyedTransform(std::vector<double>{0, 0, 0, 0, 0, 0, 0, 2, 3, 4}, "linear");
    Points points = {
        {1.999, 2.999, 3.999}, {2.001, 0, 0}, {0, 3.001, 0}, {0, 0, 4.001}, {-1.99, -2.99, -3.99}};
    const auto values = evaluate_gusts(gusts, points, 0.0);
    EXPECT_EQ(values[0], 1.0F);
    EXPECT_EQ(values[1], 0.0F);
    EXPECT_EQ(values[2], 0.0F);
    EXPECT_EQ(values[3], 0.0F);
    EXPECT_EQ(values[4], 1.0F);
}

// ---- Reading ----

// Values as a host passes them: the numbers that the test sets, everything else at the defaults of this
// class.
class GustValues {
  public:
    GustValues() {
        set("speed", {4});
        set("gusts.num_gusts", {3});
        set("gusts.radius_range", {2, 4});
        set("gusts.radius_noise_range", {0, 0.3});
        set("gusts.life_range", {120, 240});
        set("gusts.decay_range", {24, 48});
        set("gusts.period", {240});
        set("gusts.redraw", {0});
        set("gusts.ramp", {0, 1, 1, 0}, "smooth");
        set("gusts.strength", {1});
        set("gusts.seed", {0});
    }
    void set(const std::string& name, std::vector<double> numbers, const std::string& text = "") {
        const std::string full = "wind." + name;
        std::erase_if(values_, [&](const MarramValue& value) { return full == value.name; });
        MarramValue value{};
        value.name = texts_.emplace_back(full).c_str();
        const std::vector<double>& kept = numbers_.emplace_back(std::move(numbers));
        value.numbers = kept.data();
        value.number_count = kept.size();
        value.text = texts_.emplace_back(text).c_str();
        value.place = texts_.emplace_back("at " + name).c_str();
        values_.push_back(value);
    }
    void control(int i, const std::string& shape) {
        const std::string prefix = "gusts.control[" + std::to_string(i) + "].";
        set(prefix + "shape", {}, shape);
        set(prefix + "transform", {0, double(i), 0, 0, 0, 0, 0, 2, 2, 2}, "linear");
        set(prefix + "ramp", {0, 1, 1, 0}, "linear");
        set(prefix + "strength", {0.5});
    }
    std::optional<Gusts> read() const { return read_gusts(Values(values_)); }
    std::string fault() const {
        try {
            read();
        } catch (const SceneFault& fault) {
            return fault.place + ": " + fault.what() + ": " + fault.remedy;
        }
        return "";
    }

  private:
    std::vector<MarramValue> values_;
    std::deque<std::vector<double>> numbers_;
    std::deque<std::string> texts_;
};

TEST(Gusts, AreRead) {
    GustValues values;
    const Gusts gusts = values.read().value();
    EXPECT_EQ(gusts.num_gusts, 3U);
    EXPECT_EQ(gusts.speed, Vec2d(1, 1)); // relative to that of the wind
    EXPECT_TRUE(gusts.speed_is_relative);
    EXPECT_EQ(gusts.start_frame, Vec2d(0, 240));
    EXPECT_FALSE(gusts.center || gusts.extent || gusts.distance);
    values.set("gusts.speed_range", {1, 2});
    values.set("gusts.center", {1, 2, 3});
    values.set("gusts.extent", {8, 9});
    values.set("gusts.distance", {7});
    values.control(0, "sphere");
    values.control(1, "box");
    values.set("gusts.control[1].inner", {0.1, 0.2, 0.3});
    const Gusts more = values.read().value();
    EXPECT_EQ(more.speed, Vec2d(1, 2));
    EXPECT_FALSE(more.speed_is_relative);
    EXPECT_EQ(*more.center, Vec3d(1, 2, 3));
    EXPECT_EQ(*more.extent, Vec2d(8, 9));
    EXPECT_EQ(*more.distance, 7.0);
    ASSERT_EQ(more.controls.size(), 2U);
    EXPECT_FALSE(more.controls[0].box);
    EXPECT_TRUE(more.controls[1].box);
    EXPECT_EQ(more.controls[1].inner, Vec3d(0.1, 0.2, 0.3));
    EXPECT_EQ(more.controls[1].transform.at(0.0).translation(), Vec3d(1, 0, 0));
    EXPECT_EQ(more.controls[1].strength, 0.5);
    values.set("gusts.num_gusts", {0});
    EXPECT_EQ(values.read()->controls.size(), 2U);
    GustValues none;
    none.set("gusts.num_gusts", {0});
    EXPECT_FALSE(none.read().has_value());
}

TEST(Gusts, MistakesAreExplained) {
    const auto expect = [](const GustValues& values, const std::string& message) {
        EXPECT_EQ(values.fault().find(message), 0U) << values.fault() << "\n  expected " << message;
    };
    GustValues a;
    a.set("gusts.ramp", {0, 1, 1, 0.5}, "linear");
    expect(a, "at gusts.ramp: wind.gusts.ramp is not 0 at 1: end the ramp with the knot [1, 0]");
    GustValues b;
    b.set("gusts.ramp", {0, 1, 0.5, 0}, "constant");
    expect(
        b,
        "at gusts.ramp: wind.gusts.ramp is constant between knots: strands would jump: use linear or smooth");
    GustValues c;
    c.set("gusts.period", {0.5});
    expect(c, "at gusts.period: wind.gusts.period is shorter than a frame: give at least 1 frame");
    c.set("gusts.period", {0});
    expect(c, "at gusts.period: wind.gusts.period is 0 and wind.gusts.start_frame_range is missing: give");
    c.set("gusts.start_frame_range", {1, 10});
    expect(c, "");
    c.set("gusts.period", {1});
    c.set("gusts.num_gusts", {1000000});
    expect(c, "at gusts.period: wind.gusts has more than 4000000 gusts at a time: use fewer");
    GustValues d;
    d.control(0, "sphere");
    d.set("gusts.control[0].inner", {1, 1, 1});
    expect(d, "at gusts.control[0].inner: wind.gusts.control[0].inner applies to boxes only: remove it");
    GustValues e;
    e.control(0, "box");
    e.control(1, "box");
    e.set("gusts.control[1].ramp", {0, 1}, "linear");
    expect(e, "at gusts.control[1].ramp: wind.gusts.control[1].ramp is not 0 at 1");
}

TEST(Gusts, AreDeclaredWithTheWind) {
    const auto all = wind_params();
    for (const MarramParam& param : gust_params()) {
        EXPECT_TRUE(std::string(param.name).starts_with("gusts.")) << param.name;
        EXPECT_GT(std::strlen(param.help), 0U);
        EXPECT_LE(param.minimum, param.maximum);
        EXPECT_EQ(std::ranges::count_if(
                      all, [&](const MarramParam& p) { return !std::strcmp(p.name, param.name); }),
                  1);
    }
}

} // namespace
