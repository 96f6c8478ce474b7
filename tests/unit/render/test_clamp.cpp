// SPDX-License-Identifier: Apache-2.0
// The clamp on indirect light: it leaves direct light unchanged and reports how much it removes.
#include "tests/unit/render/world_builder.h"
#include "tests/unit/shaders/default_params.h"

#include "core/render/integrator.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using testing::Triangles;

// A polished ball on a floor in the sun: its caustic on the floor is found by chance and is bright.
const World& ball_on_floor() {
    static testing::WorldBuilder builder;
    static const World& world = [&]() -> World& {
        const Triangles floor = testing::quad({-3.0, 0.0, 3.0}, {6.0, 0.0, 0.0}, {0.0, 0.0, -6.0}),
                        ball = testing::sphere({0.0, 1.0, 0.0}, 1.0, 64, 32);
        builder.mesh({floor.positions}, floor.triangles, 0);
        builder.mesh({ball.positions}, ball.triangles, 1);
        return builder.commit();
    }();
    return world;
}

struct Picture {
    std::vector<float> pixels; // rgb
    RenderStats stats;
};

Picture picture(float clamp, uint32_t samples, uint32_t max_depth = 6, uint64_t seed = 1,
                double noise = 0.0) {
    const World& world = ball_on_floor();
    Camera camera;
    camera.poses = {look_at({0.0, 3.0, 7.0}, {0.0, 0.7, 0.0}, Vec3d::UnitY())};
    camera.vertical_fov = 40.0 * degree;
    RenderSettings settings;
    settings.filter = {FilterKind::box, 0.5};
    settings.samples = samples;
    settings.max_depth = max_depth;
    settings.indirect_clamp = clamp;
    settings.seed = seed;
    settings.noise_threshold = noise;
    const std::vector<Material> materials = {
        testing::material_of("diffuse", {{"color", "0.6"}}),
        testing::material_of("surface", {{"color", "0.7"}, {"roughness", "0.15"}})};
    SunLight sun;
    sun.direction = {1.0, 1.0, 0.3};
    sun.irradiance = Vec3f(20.0F, 16.0F, 10.0F);
    const std::vector<std::string> layers = {"beauty", "variance"};
    const std::vector<LightDescription> lights = {sun, SkyLight{}};
    Film film = make_film(64, 48, layers, world);
    Picture result;
    result.stats = render(world, Lights(lights, world), materials, camera, settings, film);
    result.pixels = find_layer(film, "beauty")->values;
    return result;
}

double brightness(const Picture& picture) {
    double sum = 0.0;
    for (size_t i = 0; i < picture.pixels.size(); i += 3)
        sum += 0.2126 * double(picture.pixels[i]) + 0.7152 * double(picture.pixels[i + 1]) +
               0.0722 * double(picture.pixels[i + 2]);
    return sum;
}

TEST(Clamp, LeavesWhatIsBelowIt) {
    EXPECT_EQ(picture(0.0F, 5).pixels, picture(1e6F, 5).pixels);
    EXPECT_EQ(picture(0.0F, 5).stats.clamped_fraction, 0.0);
}

TEST(Clamp, LeavesDirectLight) {
    const Picture clamped = picture(1e-6F, 5, 1);
    EXPECT_EQ(clamped.pixels, picture(0.0F, 5, 1).pixels);
    EXPECT_EQ(clamped.stats.clamped_fraction, 0.0);
}

// One sample a pixel, the same path with and without a clamp: indirect light is scaled down to the clamp, and
// the reported loss is the missing light.
TEST(Clamp, TakesWhatItTells) {
    constexpr float limit = 0.5F;
    const Picture plain = picture(0.0F, 1), clamped = picture(limit, 1), direct = picture(0.0F, 1, 1);
    size_t cut = 0;
    for (size_t i = 0; i < plain.pixels.size(); i += 3) {
        const Vec3f all = Vec3f::Map(&plain.pixels[i]), left = Vec3f::Map(&clamped.pixels[i]);
        const Vec3f later = all - Vec3f::Map(&direct.pixels[i]);
        const float most = later.maxCoeff();
        const Vec3f expected = most > limit ? Vec3f(all - later * (1.0F - limit / most)) : all;
        EXPECT_LT((left - expected).cwiseAbs().maxCoeff(), 1e-5F * (1.0F + all.maxCoeff()));
        cut += most > limit;
    }
    const double share = clamped.stats.clamped_fraction;
    std::printf("[ clamp ] %zu of %zu samples cut, %.3f of the light taken\n", cut, plain.pixels.size() / 3,
                share);
    EXPECT_GT(cut, 20U);
    EXPECT_NEAR(brightness(clamped) / brightness(plain), 1.0 - share, 1e-6);
}

// Many samples: the roulette on shadow rays boosts survivors by no more than the clamp lets pass, so that the
// clamp removes no more than from the paths themselves; and the result has less noise.
TEST(Clamp, TakesNoMoreForTheRoulette) {
    constexpr float limit = 2.0F;
    double by_paths = 0.0;
    constexpr int seeds = 64;
    for (uint64_t seed = 1; seed <= seeds; ++seed)
        by_paths += picture(limit, 1, 6, seed).stats.clamped_fraction / seeds;
    const double by_roulette = picture(limit, 256).stats.clamped_fraction;
    const double plain = brightness(picture(0.0F, 1024)), clamped = brightness(picture(limit, 1024));
    std::printf("[ clamp ] %.4f of the light taken from paths, %.4f with the roulette; missing %.4f\n",
                by_paths, by_roulette, 1.0 - clamped / plain);
    EXPECT_GT(by_paths, 0.001);
    EXPECT_LT(by_roulette, 1.1 * by_paths);
    EXPECT_NEAR(1.0 - clamped / plain, by_roulette, 0.3 * by_roulette);
}

// Noisy pixels, where the clamp removes more, get more samples: the reported loss is that of the picture, not
// of its samples.
TEST(Clamp, TellsOfThePictureNotOfItsSamples) {
    constexpr float limit = 2.0F;
    const Picture even = picture(limit, 256), uneven = picture(limit, 256, 6, 1, 0.02);
    std::printf("[ clamp ] %.4f of the light taken with 256 samples, %.4f with %.1f\n",
                even.stats.clamped_fraction, uneven.stats.clamped_fraction, uneven.stats.mean_samples);
    EXPECT_LT(uneven.stats.mean_samples, 128.0);
    EXPECT_NEAR(uneven.stats.clamped_fraction, even.stats.clamped_fraction,
                0.15 * even.stats.clamped_fraction);
}

} // namespace
} // namespace marram
