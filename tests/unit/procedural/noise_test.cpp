// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/noise.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <cstdio>

using namespace marram;

namespace {

Wide3d random_points(uint64_t i, double scale) {
    Wide3d p;
    for (int lane = 0; lane < lanes; ++lane) {
        const uint64_t h = hash(i, uint64_t(lane));
        p.x[lane] = scale * (unit_double(h) - 0.5);
        p.y[lane] = scale * (unit_double(mix64(h + 1)) - 0.5);
        p.z[lane] = scale * (unit_double(mix64(h + 2)) - 0.5);
    }
    return p;
}

double component(const Wide3f& v, int axis, int lane) {
    return double(axis == 0 ? v.x[lane] : axis == 1 ? v.y[lane] : v.z[lane]);
}

Wide3f at(const FractalNoise& noise, double x, double y, double z, bool four = false, double w = 0.0) {
    const Wide3d p{splat(x), splat(y), splat(z)};
    Wide3f value;
    vector_noise(noise, &p, 1, four, w, &value);
    return value;
}

} // namespace

TEST(PerlinNoise, range_mean_and_independence) {
    for (const bool four : {false, true}) {
        double sum[3] = {}, squares[3] = {}, products[3] = {}, greatest = 0.0;
        constexpr int count = 250'000;
        for (uint64_t i = 0; i < count / lanes; ++i) {
            const Wide3d p = random_points(i, 1000.0);
            Wide3f v;
            vector_noise({}, &p, 1, four, double(i) * 0.37, &v);
            for (int lane = 0; lane < lanes; ++lane)
                for (int axis = 0; axis < 3; ++axis) {
                    const double x = component(v, axis, lane), y = component(v, (axis + 1) % 3, lane);
                    sum[axis] += x;
                    squares[axis] += x * x;
                    products[axis] += x * y;
                    greatest = std::max(greatest, std::abs(x));
                }
        }
        for (int axis = 0; axis < 3; ++axis) {
            const double rms = std::sqrt(squares[axis] / count);
            std::printf("%d-D axis %d: mean %+.4f rms %.4f correlation with next %+.4f greatest %.3f\n",
                        four ? 4 : 3, axis, sum[axis] / count, rms, products[axis] / squares[axis], greatest);
            EXPECT_NEAR(sum[axis] / count, 0.0, 0.01);
            EXPECT_NEAR(rms, 0.28, 0.05);
            EXPECT_NEAR(products[axis] / squares[axis], 0.0, 0.02);
        }
        EXPECT_LE(greatest, four ? 1.6 : 1.04);
        EXPECT_GT(greatest, 0.7);
    }
}

TEST(PerlinNoise, zero_at_lattice_points_near_and_far) {
    for (const double x : {0.0, 1.0, -1.0, 17.0, 1e6, -1e6, 3e9})
        for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(component(at({}, x, -x, 2.0 * x), axis, 0), 0.0) << x;
}

// Value, slope and curvature agree across a cell's face.
TEST(PerlinNoise, twice_differentiable_across_faces) {
    constexpr double h = 1e-2;
    for (int i = 0; i < 200; ++i) {
        const double y = unit_double(mix64(uint64_t(i))) * 50.0,
                     z = unit_double(mix64(uint64_t(i) + 999)) * 50.0;
        const double x = double(i - 100);
        for (int axis = 0; axis < 3; ++axis) {
            const auto f = [&](double at_x) { return component(at({}, at_x, y, z), axis, 0); };
            const double slope_left = (f(x) - f(x - h)) / h, slope_right = (f(x + h) - f(x)) / h;
            EXPECT_NEAR(slope_left, slope_right, 6.0 * h); // |f''| at a face stays small
        }
    }
}

// A slab of the field holds in 32-bit hash cells what a shifted slab does not: no short period along any axis.
TEST(PerlinNoise, does_not_repeat) {
    for (const double period : {256.0, 512.0, 4096.0, 65536.0}) {
        double difference = 0.0;
        for (int i = 0; i < 64; ++i) {
            const double t = 0.37 * i;
            difference += std::abs(component(at({}, t, 0.4, 0.7), 0, 0) -
                                   component(at({}, t + period, 0.4, 0.7), 0, 0));
        }
        EXPECT_GT(difference / 64, 0.1) << period;
    }
}

TEST(PerlinNoise, octaves_keep_their_strength) {
    double rms[4] = {};
    for (int octaves = 1; octaves <= 4; ++octaves) {
        FractalNoise noise;
        noise.octaves = octaves;
        for (uint64_t i = 0; i < 8000; ++i) {
            const Wide3d p = random_points(i, 500.0);
            Wide3f v;
            vector_noise(noise, &p, 1, false, 0.0, &v);
            for (int lane = 0; lane < lanes; ++lane)
                rms[octaves - 1] += double(v.x[lane]) * double(v.x[lane]);
        }
    }
    for (int i = 1; i < 4; ++i) EXPECT_NEAR(std::sqrt(rms[i] / rms[0]), 1.0, 0.05);
}

// The fourth dimension is a noise like any other: still at whole cells, smooth between.
TEST(PerlinNoise, evolution_is_continuous) {
    double before = component(at({}, 0.3, 0.4, 0.5, true, 0.0), 0, 0), moved = 0.0;
    for (double w = 0.001; w < 5.0; w += 0.001) {
        const double value = component(at({}, 0.3, 0.4, 0.5, true, w), 0, 0);
        EXPECT_LT(std::abs(value - before), 0.01);
        moved += std::abs(value - before);
        before = value;
    }
    EXPECT_GT(moved, 0.5);
}
