// SPDX-License-Identifier: Apache-2.0
// Sample numbers, filters, cameras and pdfs of lights.
#include "tests/unit/render/world_builder.h"

#include "core/render/camera.h"
#include "core/render/filter.h"
#include "core/render/lights/lights.h"
#include "core/render/sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>

namespace marram {
namespace {

using NumberSet = std::array<float, 4>;

// The numbers of a set, for samples that begin at a multiple of `count`.
std::vector<NumberSet> numbers_of(uint64_t pixel, uint32_t set, uint32_t first, uint32_t count) {
    std::vector<NumberSet> all;
    for (uint32_t s = first; s < first + count; ++s) all.push_back(Sampler(hash(1, pixel), s).get_4d(set));
    return all;
}

// The fewest and the most points in a cell, if dimension d is halved bits[d] times.
std::pair<size_t, size_t> points_per_cell(const std::vector<NumberSet>& points,
                                          const std::array<int, 4>& bits) {
    std::vector<size_t> cells(size_t(1) << (bits[0] + bits[1] + bits[2] + bits[3]));
    for (const NumberSet& point : points) {
        size_t cell = 0;
        for (size_t d = 0; d < 4; ++d)
            cell = (cell << bits[d]) | static_cast<size_t>(std::ldexp(point[d], bits[d]));
        ++cells[cell];
    }
    const auto [least, most] = std::ranges::minmax(cells);
    return {least, most};
}

TEST(Sampler, FillsEveryElementaryInterval) {
    for (uint64_t pixel = 0; pixel < 10; ++pixel)
        for (uint32_t set = 0; set < 5; ++set)
            for (const uint32_t first : {0U, 0x10100U, 0xabcdef00U}) // uses every byte of the index
                for (const int bits : {2, 4, 6, 8}) {
                    if (set > 0 && bits < 4) continue; // sets are shuffled in groups of 16
                    const std::vector<NumberSet> points = numbers_of(pixel, set, first, 1U << bits);
                    for (const NumberSet& point : points)
                        for (const float x : point) ASSERT_TRUE(x >= 0.0F && x < 1.0F);
                    for (int split = 0; split <= bits; ++split)
                        EXPECT_EQ(points_per_cell(points, {split, bits - split, 0, 0}),
                                  std::pair(size_t(1), size_t(1)));
                    for (size_t d = 0; d < 4; ++d) {
                        std::array<int, 4> along{};
                        along[d] = bits;
                        EXPECT_EQ(points_per_cell(points, along), std::pair(size_t(1), size_t(1)));
                    }
                }
}

// In all four dimensions: 8 points in each elementary interval of 8 times a point's volume.
TEST(Sampler, FillsFourDimensions) {
    for (uint64_t pixel = 0; pixel < 10; ++pixel)
        for (uint32_t set = 0; set < 3; ++set) {
            const std::vector<NumberSet> points = numbers_of(pixel, set, 512 * set, 512);
            for (int a = 0; a <= 6; ++a)
                for (int b = 0; a + b <= 6; ++b)
                    for (int c = 0; a + b + c <= 6; ++c)
                        EXPECT_EQ(points_per_cell(points, {a, b, c, 6 - a - b - c}),
                                  std::pair(size_t(8), size_t(8)));
        }
}

// RMSE of a smooth or a discontinuous integral over 200 pixels.
double integration_error(uint32_t samples, bool random, bool smooth) {
    double sum = 0.0;
    for (uint64_t pixel = 0; pixel < 200; ++pixel) {
        double mean = 0.0;
        for (uint32_t s = 0; s < samples; ++s) {
            const NumberSet n = Sampler(hash(2, pixel), s).get_4d(3);
            Vec2f at(n[0], n[1]);
            if (random) {
                const uint64_t h = hash(hash(3, pixel), s);
                at = {unit_float(static_cast<uint32_t>(h)), unit_float(static_cast<uint32_t>(h >> 32))};
            }
            mean += (smooth ? std::exp(-static_cast<double>(at.squaredNorm()))
                            : (at.squaredNorm() < 1.0F ? 1.0 : 0.0)) /
                    samples;
        }
        const double error = mean - (smooth ? 0.25 * pi * std::erf(1.0) * std::erf(1.0) : 0.25 * pi);
        sum += error * error / 200.0;
    }
    return std::sqrt(sum);
}

TEST(Sampler, ConvergesFasterThanRandom) {
    for (const bool smooth : {true, false}) {
        const double e16 = integration_error(16, false, smooth),
                     e1024 = integration_error(1024, false, smooth);
        const double random = integration_error(1024, true, smooth);
        const double rate = std::log(e16 / e1024) / std::log(64.0);
        std::printf("[ sampler ] %s: error %.1e at 1024 samples (random %.1e), falls as n^-%.2f\n",
                    smooth ? "smooth" : "disc", e1024, random, rate);
        EXPECT_GT(rate, smooth ? 1.3 : 0.65);
        EXPECT_LT(e1024, random / (smooth ? 100.0 : 3.0));
    }
}

// Numbers of two sets, and of two pixels, are as independent as a random order makes them: the mean of a
// product has the variance of independent numbers, except within the 16 that are shuffled together.
TEST(Sampler, SetsAreFreeOfEachOther) {
    constexpr uint32_t pixels = 4000;
    const auto left = [](float x) { return x < 0.5F ? -1.0 : 1.0; };
    const auto fine = [](float x) { return static_cast<int>(16.0F * x) % 2 == 0 ? -1.0 : 1.0; };
    const auto slope = [](float x) { return std::sqrt(12.0) * (static_cast<double>(x) - 0.5); };
    for (const uint32_t samples : {16U, 64U, 256U}) {
        double most = 0.0;
        for (size_t d = 0; d < 4; ++d)
            for (size_t e = 0; e < 4; ++e) {
                std::array<double, 4> variance{};
                for (uint64_t pixel = 0; pixel < pixels; ++pixel) {
                    std::array<double, 4> mean{};
                    for (uint32_t s = 0; s < samples; ++s) {
                        const Sampler sampler(hash(1, pixel), s);
                        const float x = sampler.get_4d(0)[d], y = sampler.get_4d(3)[e],
                                    z = Sampler(hash(2, pixel), s).get_4d(3)[e];
                        mean[0] += left(x) * left(y) / samples;
                        mean[1] += fine(x) * fine(y) / samples;
                        mean[2] += slope(x) * slope(y) / samples;
                        mean[3] += slope(sampler.get_4d(2)[d]) * slope(z) / samples;
                    }
                    for (size_t f = 0; f < 4; ++f) variance[f] += mean[f] * mean[f] * samples / pixels;
                }
                for (size_t f = 0; f < 4; ++f) {
                    most = std::max(most, variance[f]);
                    EXPECT_GT(variance[f], 0.85) << samples << " " << d << e << f;
                    EXPECT_LT(variance[f], 1.25) << samples << " " << d << e << f;
                }
            }
        std::printf("[ sampler ] %u samples: a product over two sets varies at most %.2f times as much as of "
                    "free numbers\n",
                    samples, most);
    }
}

TEST(Filter, DrawsWithItsShapeAsDensity) {
    for (const FilterKind kind :
         {FilterKind::box, FilterKind::triangle, FilterKind::gaussian, FilterKind::blackman_harris}) {
        const double radius = 1.7;
        const FilterSampler sampler({kind, radius});
        constexpr int cells = 20, count = 200000;
        std::vector<double> seen(cells, 0.0), expected(cells, 0.0);
        double total = 0.0, last = -radius;
        for (int i = 0; i < count; ++i) {
            const double x = sampler(static_cast<float>((i + 0.5) / count));
            EXPECT_GE(x, last);
            last = x;
            seen[static_cast<size_t>(std::clamp((x / radius + 1.0) * 0.5 * cells, 0.0, cells - 1.0))] +=
                1.0 / count;
        }
        for (int i = 0; i < cells * 100; ++i) {
            const double value = filter_value(kind, -1.0 + 2.0 * (i + 0.5) / (cells * 100));
            expected[static_cast<size_t>(i / 100)] += value;
            total += value;
        }
        for (size_t c = 0; c < cells; ++c)
            EXPECT_NEAR(seen[c], expected[c] / total, 5e-4) << static_cast<int>(kind);
        EXPECT_LE(last, radius);
    }
}

TEST(Camera, LooksWhereItIsToldAndFocuses) {
    Camera camera;
    camera.poses = {look_at({1.0, 2.0, 3.0}, {1.0, 2.0, -7.0}, Vec3d::UnitY())};
    camera.vertical_fov = 90.0 * degree;
    const CameraRays pinhole(camera, 200, 100);
    EXPECT_TRUE(pinhole(0.5, 0.5, {0.5F, 0.5F}, 0.0F).direction.isApprox(Vec3f(0.0F, 0.0F, -1.0F)));
    EXPECT_TRUE(
        pinhole(0.5, 0.0, {0.5F, 0.5F}, 0.0F).direction.isApprox(Vec3f(0.0F, 1.0F, -1.0F).normalized()));
    EXPECT_TRUE(
        pinhole(1.0, 0.5, {0.5F, 0.5F}, 0.0F).direction.isApprox(Vec3f(2.0F, 0.0F, -1.0F).normalized()));
    camera.lens_radius = 0.1;
    camera.focus_distance = 4.0;
    const CameraRays lens(camera, 200, 100);
    const Ray middle = pinhole(0.7, 0.2, {0.5F, 0.5F}, 0.0F);
    const Vec3f focus = middle.origin + middle.direction * (4.0F / -middle.direction.z());
    for (const Vec2f& at : {Vec2f(0.0F, 0.0F), Vec2f(0.9F, 0.3F), Vec2f(0.2F, 0.99F)}) {
        const Ray ray = lens(0.7, 0.2, at, 0.0F);
        EXPECT_LE((ray.origin - middle.origin).norm(), 0.1F * (1.0F + 1e-5F));
        EXPECT_LT((focus - ray.origin).cross(ray.direction).norm(), 1e-5F);
    }
}

// Monte Carlo with the lights' own samples gives their irradiance integrated over all orientations; sample
// pdfs agree with those evaluated for a direction later.
double check_light(const LightDescription& light) {
    const EnvironmentLight* map = std::get_if<EnvironmentLight>(&light);
    float brightest = 1e-30F;
    const float width = map ? float(map->image.width) : 1.0F;
    if (map)
        for (const Vec3f& pixel : map->image.pixels)
            brightest = std::max(brightest, map->strength * pixel.x());
    const World world;
    const std::vector<LightDescription> all = {light};
    const Lights lights(all, world);
    double sum = 0.0;
    constexpr uint32_t count = 4096;
    for (uint32_t s = 0; s < count; ++s) {
        const NumberSet n = Sampler(4, s).get_4d(0);
        const Vec2f at(n[0], n[1]);
        const LightSample drawn = lights.sample(Vec3d::Zero(), 0.0F, {0.5F, at.x(), at.y()});
        if (!(drawn.pdf > 0.0F)) continue;
        sum += static_cast<double>(drawn.radiance.x() / drawn.pdf) / count;
        EXPECT_NEAR(drawn.direction.norm(), 1.0F, 1e-6F);
        if (drawn.delta) continue;
        float pdf = -1.0F;
        const Vec3f seen = lights.environment_radiance(drawn.direction, false, [&](float p) {
            pdf = p;
            return 1.0F;
        });
        if (pdf < 0.0F) continue; // on the disc's rim
        // Evaluated again for a float direction: its error is a few 1e-7 of an image's width.
        EXPECT_NEAR(seen.x(), drawn.radiance.x(), 1e-5F * drawn.radiance.x() + 2e-7F * brightest * width);
        EXPECT_NEAR(pdf / drawn.pdf, 1.0F, 0.9F); // at most a neighbouring cell
    }
    return sum;
}

TEST(Lights, SendWhatTheyAreToldTo) {
    EXPECT_NEAR(check_light(SkyLight{}), 4.0 * pi, 1e-4);
    EXPECT_NEAR(check_light(SunLight{{1.0, 1.0, 0.0}, 0.0, Vec3f::Ones()}), 1.0, 1e-6);
    // Radiance over the disc, E / (pi sin^2 a) . 2 pi (1 - cos a): E to first order.
    EXPECT_NEAR(check_light(SunLight{{1.0, 1.0, 0.0}, 1e-4, Vec3f::Ones()}), 1.0, 1e-5);
    EXPECT_NEAR(check_light(SunLight{{1.0, 1.0, 0.0}, 1.0, Vec3f::Ones()}),
                2.0 * (1.0 - std::cos(0.5)) / std::pow(std::sin(0.5), 2.0), 1e-5);
    EnvironmentLight map;
    map.image.width = 16;
    map.image.height = 8;
    map.rotation = 1.1;
    map.image.pixels.edit().assign(16 * 8, Vec3f::Constant(0.5F));
    EXPECT_NEAR(check_light(map), 2.0 * pi, 1e-4);
    for (Vec3f& p : map.image.pixels.edit()) p.setZero();
    map.image.pixels.edit()[3 * 16 + 5] = Vec3f::Constant(1000.0F); // a small lamp: all samples go near it
    const double lamp = check_light(map);
    const double angle = 2.0 * pi / 16.0 * (std::cos(3.0 * pi / 8.0) - std::cos(4.0 * pi / 8.0));
    EXPECT_NEAR(lamp / (1000.0 * angle), 1.0, 0.05);
}

// Samples of a map with partial blocks at its borders: 1 / pdf adds up to the solid angle of each part of the
// sphere, and the variance of radiance over pdf is as small as the table promises, at any resolution of the
// map.
TEST(Environment, IsSampledByItsBrightness) {
    EnvironmentLight smooth;
    smooth.image.width = 300;
    smooth.image.height = 150;
    smooth.rotation = 0.7;
    for (uint32_t row = 0; row < smooth.image.height; ++row)
        for (uint32_t column = 0; column < smooth.image.width; ++column)
            smooth.image.pixels.edit().push_back(Vec3f::Constant(
                static_cast<float>(1.0 + 0.4 * std::sin(2.0 * pi * column / 300.0) + 0.4 * row / 150.0)));
    EnvironmentLight sunny = smooth;
    sunny.image.pixels.edit()[40 * 300 + 299] = Vec3f::Constant(2e4F);
    for (const bool has_sun : {false, true}) {
        const World world;
        const std::vector<LightDescription> all = {has_sun ? sunny : smooth};
        const Lights lights(all, world);
        constexpr uint32_t count = 1 << 16, sectors = 8, bands = 4;
        std::array<double, sectors * bands> angle{};
        double sum = 0.0, squares = 0.0;
        for (uint32_t s = 0; s < count; ++s) {
            const NumberSet n = Sampler(7, s).get_4d(0);
            const Vec2f at(n[0], n[1]);
            const LightSample drawn = lights.sample(Vec3d::Zero(), 0.0F, {0.5F, at.x(), at.y()});
            ASSERT_GT(drawn.pdf, 0.0F);
            const double light = static_cast<double>(drawn.radiance.x() / drawn.pdf);
            sum += light / count;
            squares += light * light / count;
            const Vec3f d = drawn.direction;
            const double turn = (std::atan2(d.z(), d.x()) + pi) / (2.0 * pi);
            const auto sector = std::min(static_cast<uint32_t>(turn * sectors), sectors - 1),
                       band = std::min(static_cast<uint32_t>(0.5F * (1.0F + d.y()) * bands), bands - 1);
            angle[band * sectors + sector] += 1.0 / (double(drawn.pdf) * count);
        }
        std::printf("[ blocks ] %s map: variance of light over density %.4f of its mean's square\n",
                    has_sun ? "sunny" : "smooth", squares / (sum * sum) - 1.0);
        // The sun is one pixel, interpolated over its neighbours; a table cannot follow that.
        EXPECT_LT(squares / (sum * sum) - 1.0, has_sun ? 1.0 : 0.006);
        if (has_sun) continue;
        for (const double a : angle) EXPECT_NEAR(a / (4.0 * pi / (sectors * bands)), 1.0, 0.02);
    }
}

TEST(Environment, ManyTurnsAreNone) {
    EnvironmentLight map;
    map.image.width = 64;
    map.image.height = 32;
    map.image.pixels.edit().assign(64 * 32, Vec3f::Ones());
    map.rotation = 0.7;
    EnvironmentLight turned = map;
    turned.rotation += 200.0 * pi; // 36,000 degrees: the limit for a scene
    const World world;
    const std::vector<LightDescription> one = {map}, other = {turned};
    const Lights a(one, world), b(other, world);
    for (uint32_t s = 0; s < 256; ++s) {
        const NumberSet n = Sampler(8, s).get_4d(0);
        const Vec3f from = a.sample(Vec3d::Zero(), 0.0F, {n[0], n[1], n[2]}).direction,
                    to = b.sample(Vec3d::Zero(), 0.0F, {n[0], n[1], n[2]}).direction;
        EXPECT_LT((from - to).norm(), 1e-6F);
    }
}

TEST(Environment, FacesWhereItShould) {
    EnvironmentLight map;
    map.image.width = 64;
    map.image.height = 32;
    map.image.pixels.edit().assign(64 * 32, Vec3f::Zero());
    const auto put = [&](uint32_t column, uint32_t row, const Vec3f& color) { // 4 x 4 pixels about a corner
        for (uint32_t y = row - 2; y < row + 2; ++y)
            for (uint32_t x = column - 2; x < column + 2; ++x) map.image.pixels.edit()[y * 64 + x] = color;
    };
    put(32, 16, Vec3f(1.0F, 0.0F, 0.0F));
    put(48, 16, Vec3f(0.0F, 1.0F, 0.0F));
    EXPECT_TRUE(environment_radiance(map, -Vec3f::UnitZ()).isApprox(Vec3f(1.0F, 0.0F, 0.0F)));
    EXPECT_TRUE(environment_radiance(map, Vec3f::UnitX()).isApprox(Vec3f(0.0F, 1.0F, 0.0F)));
    map.rotation = 0.5 * pi;
    EXPECT_TRUE(environment_radiance(map, -Vec3f::UnitX()).isApprox(Vec3f(1.0F, 0.0F, 0.0F)));
    EXPECT_TRUE(environment_radiance(map, -Vec3f::UnitZ()).isApprox(Vec3f(0.0F, 1.0F, 0.0F)));
}

TEST(Sky, AlikeColoursAreExact) {
    for (int i = 0; i < 1000; ++i) {
        const Vec3f d = Vec3f(0.3F, -1.0F + 0.002F * static_cast<float>(i), 0.7F).normalized();
        EXPECT_EQ(sky_radiance(SkyLight{}, d), Vec3f::Ones());
    }
}

// Whatever the haze, the land is hidden at the horizon and seen below, and the light that is sampled is all
// there is.
TEST(Sky, HazeHidesTheLandAtTheHorizon) {
    for (const float haze : {0.0F, 1e-4F, 0.01F, 1.0F}) {
        SkyLight sky;
        sky.haze = haze;
        sky.ground = Vec3f::Zero();
        EXPECT_EQ(sky_radiance(sky, Vec3f::UnitX()), Vec3f::Ones());
        EXPECT_FLOAT_EQ(sky_radiance(sky, -Vec3f::UnitY()).x(), 1.0F - std::exp(-haze));
        float before = 1.0F;
        double air = 0.0; // radiance of the lower half over heights
        constexpr int steps = 100000;
        for (int i = 0; i < steps; ++i) {
            const float y = -(static_cast<float>(i) + 0.5F) / steps;
            const float now = sky_radiance(sky, Vec3f(std::sqrt(1.0F - y * y), y, 0.0F)).x();
            EXPECT_LE(now, before);
            before = now;
            air += static_cast<double>(now) / steps;
        }
        EXPECT_NEAR(check_light(sky), 2.0 * pi * (1.0 + air), 2e-3);
    }
}

} // namespace
} // namespace marram
