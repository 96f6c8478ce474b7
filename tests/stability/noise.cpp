// SPDX-License-Identifier: Apache-2.0
// Noise at lattice points and far away; gusts with zero size or life.
#include "procedural/noise/noise.h"
#include "procedural/wind/gusts.h"
#include "tests/oracle/noise.h"
#include "tests/stability/scene.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

namespace marram::stability {
namespace {

std::vector<Vec3d> noise_at(const FractalNoise& noise, const std::vector<Vec3d>& points, bool four,
                            double w) {
    const size_t blocks = (points.size() + lanes - 1) / lanes;
    WideVector<Wide3d> wide(blocks);
    WideVector<Wide3f> values(blocks);
    for (size_t i = 0; i < blocks * lanes; ++i) {
        const Vec3d& p = points[std::min(i, points.size() - 1)];
        wide[i / lanes].x[i % lanes] = p.x();
        wide[i / lanes].y[i % lanes] = p.y();
        wide[i / lanes].z[i % lanes] = p.z();
    }
    vector_noise(noise, wide.data(), int(blocks), four, w, values.data());
    std::vector<Vec3d> result;
    for (size_t i = 0; i < points.size(); ++i) {
        const Wide3f& v = values[i / lanes];
        result.emplace_back(double(v.x[i % lanes]), double(v.y[i % lanes]), double(v.z[i % lanes]));
    }
    return result;
}

constexpr NoiseType types[] = {NoiseType::perlin, NoiseType::billow, NoiseType::wavelet};

TEST(Noise, AtLatticePoints) {
    Draw draw(1);
    std::vector<Vec3d> lattice;
    for (int i = 0; i < 4096; ++i)
        lattice.push_back((Vec3d(1000.0, 1000.0, 1000.0).cwiseProduct(draw.in_cube())).array().round());
    FractalNoise noise;
    double perlin = 0.0;
    for (const Vec3d& v : noise_at(noise, lattice, false, 0.0))
        perlin = std::max(perlin, v.cwiseAbs().maxCoeff());
    row("Perlin noise at lattice points", perlin, 0.0, "1");
    // Every type is continuous at lattice points: a step of 1e-6 cells changes it by at most its slope.
    double jump = 0.0;
    for (const NoiseType type : types) {
        noise.type = type;
        std::vector<Vec3d> before = lattice, after = lattice;
        for (size_t i = 0; i < lattice.size(); ++i) {
            const Vec3d step = 0.5e-6 * draw.direction();
            before[i] -= step;
            after[i] += step;
        }
        const auto a = noise_at(noise, before, false, 0.0), b = noise_at(noise, after, false, 0.0);
        for (size_t i = 0; i < a.size(); ++i) jump = std::max(jump, (a[i] - b[i]).cwiseAbs().maxCoeff());
    }
    row("noise: jump over 1e-6 cells at a lattice point", jump, 3e-5, "1");
}

TEST(Noise, AMillionCellsAway) {
    for (const double far : {1e6, 1e7}) {
        Draw draw(2);
        std::vector<Vec3d> points;
        for (int i = 0; i < 4096; ++i) points.push_back(far * draw.direction() + draw.in_cube());
        double worst = 0.0;
        for (const bool four : {false, true}) {
            FractalNoise noise;
            noise.octaves = 3;
            noise.seed = 5;
            const oracle::Fractal reference{1.0, 3, 2.0, 0.5, 5};
            const auto values = noise_at(noise, points, four, 12.3);
            for (size_t i = 0; i < points.size(); ++i) {
                const Vec3d right = four ? oracle::fractal_noise(reference, points[i], 12.3)
                                         : oracle::fractal_noise(reference, points[i]);
                worst = std::max(worst, (values[i] - right).cwiseAbs().maxCoeff());
            }
        }
        char name[64];
        std::snprintf(name, sizeof name, "Perlin noise at %g", far);
        row(name, worst, 1e-5, "1");
    }
}

TEST(Noise, CoordinatesBeyondAllMeasure) {
    double largest = 0.0;
    std::vector<Vec3d> points;
    for (const double far :
         {1e12, 1e16, 1e30, 1e300, std::numeric_limits<double>::infinity(),
          -std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN(), 1e-300})
        for (int axis = 0; axis < 3; ++axis) {
            Vec3d p(0.3, 0.4, 0.5);
            p[axis] = far;
            points.push_back(p);
            points.push_back(Vec3d::Constant(-far));
        }
    for (const NoiseType type : types)
        for (const bool four : {false, true})
            for (const double w : {0.0, -1e30, 1e300, std::numeric_limits<double>::infinity()}) {
                FractalNoise noise;
                noise.type = type;
                noise.octaves = 8;
                for (const Vec3d& v : noise_at(noise, points, four, w))
                    largest = v.allFinite() ? std::max(largest, v.cwiseAbs().maxCoeff())
                                            : std::numeric_limits<double>::infinity();
            }
    row("noise at 1e12 ... 1e300, infinity and NaN: |value|", largest, 8.0, "1");
}

Gusts gusts_of(const Vec2d& radius, const Vec2d& life, const Vec2d& decay) {
    Gusts gusts;
    gusts.num_gusts = 40;
    gusts.radius = radius;
    gusts.radius_noise = {0.0, 0.9};
    gusts.speed = {0.0, 5.0};
    gusts.start_frame = {-20.0, 20.0};
    gusts.life = life;
    gusts.decay = decay;
    gusts.period = 50.0;
    gusts.ramp = Ramp(std::vector<double>{0, 1, 1, 0}, "smooth");
    gusts.center = Vec3d::Zero();
    gusts.extent = Vec2d(4.0, 4.0);
    gusts.distance = 2.0;
    return gusts;
}

// Gust sums at the CVs of strands around the origin.
std::vector<double> sums(const Gusts& gusts, double frame, double size = 3.0) {
    Draw draw(3);
    std::vector<Curve> rest;
    for (int i = 0; i < 64; ++i) rest.push_back(straight(size * draw.in_cube(), 0.1 * Vec3d::UnitY(), 5));
    rest.push_back(straight(Vec3d::Zero(), Vec3d::Zero(), 5));
    Strands strands = strands_of(rest);
    std::fill(strands.gust.begin(), strands.gust.end(), VFloat{});
    add_gusts(gusts_at(gusts, Vec3d::UnitX(), frame, 24.0), strands);
    std::vector<double> all;
    for (const VFloat& v : strands.gust)
        for (int lane = 0; lane < lanes; ++lane) all.push_back(double(v[lane]));
    return all;
}

TEST(Gusts, WithoutRadiusOrLife) {
    double felt = 0.0;
    for (const double frame : {-1e4, 0.0, 7.3, 25.0, 240.0, 1e6})
        for (const double v : sums(gusts_of({0, 0}, {30, 30}, {5, 5}), frame))
            felt = std::isfinite(v) ? std::max(felt, std::abs(v)) : std::numeric_limits<double>::infinity();
    row("gusts of radius 0: influence", felt, 0.0, "1");
    felt = 0.0;
    for (const double frame : {-1e4, 0.0, 7.3, 25.0, 240.0, 1e6})
        for (const double v : sums(gusts_of({1, 3}, {0, 0}, {5, 5}), frame))
            felt = std::isfinite(v) ? std::max(felt, std::abs(v)) : std::numeric_limits<double>::infinity();
    row("gusts of life 0: influence", felt, 0.0, "1");
}

TEST(Gusts, ThatDecayLongerThanTheyLiveDoNotPop) {
    for (const Vec2d& decay : {Vec2d(100, 100), Vec2d(0, 0), Vec2d(1e-30, 1e-30)}) {
        const Gusts gusts = gusts_of({1, 3}, {20, 30}, decay);
        double jump = 0.0, most = 0.0;
        std::vector<double> before = sums(gusts, -60.0);
        constexpr double step = 0.01; // frames
        for (int i = 1; i <= 12000; i += 1) {
            if (i % 100 > 20) { // a fifth of all frames is enough
                before.clear();
                continue;
            }
            const std::vector<double> now = sums(gusts, -60.0 + step * i);
            for (size_t k = 0; k < now.size(); ++k) {
                most = std::max(most, std::abs(now[k]));
                if (!before.empty()) jump = std::max(jump, std::abs(now[k] - before[k]));
            }
            before = now;
        }
        // A fade lasts at least one frame, with a slope of at most 1.5; up to eight gusts overlap here.
        char name[96];
        std::snprintf(name, sizeof name, "gusts with decay %g frames and life 20 ... 30: step in 0.01 frames",
                      decay[0]);
        row(name, jump, 8 * 1.5 * step, "1");
        EXPECT_GT(most, 0.1);
    }
}

TEST(Gusts, OfAbsurdSizeSpeedAndTime) {
    double least = 0.0;
    bool finite = true;
    for (const double size : {1e-30, 1e-9, 1e9, 1e30})
        for (const double frame : {-1e4, 1e6, 1e15}) {
            Gusts gusts = gusts_of({size, 2 * size}, {30, 1e6}, {5, 1e6});
            gusts.period = 1e6; // read_gusts rejects more than four million at a time
            gusts.speed = {0.0, size};
            for (const double v : sums(gusts, frame)) {
                finite = finite && std::isfinite(v);
                least = std::min(least, v);
            }
        }
    none("gusts of 1e-30 ... 1e30 m: not finite or negative", !finite + (least < 0.0), "runs");
}

} // namespace
} // namespace marram::stability
