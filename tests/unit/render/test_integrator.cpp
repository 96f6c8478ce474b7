// SPDX-License-Identifier: Apache-2.0
// The path tracer against closed forms: furnaces, form factors, silhouettes, motion.
#include "tests/unit/render/world_builder.h"
#include "tests/unit/shaders/default_params.h"

#include "core/render/integrator.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cstdio>

namespace marram {

void PrintTo(Strategy strategy, std::ostream* out) {
    static constexpr const char* names[] = {"mis", "light_sampling", "bsdf_sampling"};
    *out << names[size_t(strategy)];
}

namespace {

using testing::Cv;
using testing::Triangles;
using testing::WorldBuilder;

Material diffuse(const Vec3f& color) {
    DiffuseSettings settings;
    settings.color.color = color;
    Material material;
    material.settings = settings;
    return material;
}

struct Shot {
    Camera camera;
    RenderSettings settings;
    uint32_t width = 32, height = 32;
    std::vector<Material> materials = {diffuse(Vec3f::Ones())};
    std::vector<LightDescription> lights = {SkyLight{}};
    std::vector<std::string> layers = {"beauty", "alpha"};
    RenderStats stats;

    Film operator()(const World& world) {
        Film film = make_film(width, height, layers, world);
        const Lights tables(lights, world);
        stats = render(world, tables, materials, camera, settings, film);
        EXPECT_EQ(stats.rays.invalid, 0U);
        EXPECT_EQ(stats.nonfinite_samples, 0U);
        return film;
    }
};

Shot shot_from(const Vec3d& from, const Vec3d& to, double fov_degrees) {
    Shot shot;
    const Vec3d up = std::abs((to - from).normalized().y()) > 0.99 ? Vec3d::UnitZ() : Vec3d::UnitY();
    shot.camera.poses = {look_at(from, to, up)};
    shot.camera.vertical_fov = fov_degrees * degree;
    shot.settings.filter = {FilterKind::box, 0.5};
    return shot;
}

double mean_of(const Film& film, const char* layer) {
    double sum = 0.0;
    const std::vector<float>& pixels = find_layer(film, layer)->values;
    for (const float p : pixels) sum += p;
    return sum / static_cast<double>(pixels.size());
}

Triangles ball() { return testing::sphere(Vec3d::Zero(), 1.0, 96, 48); }

TEST(Furnace, WhiteSphereInWhiteSkyIsWhite) {
    WorldBuilder builder;
    const Triangles mesh = ball();
    builder.mesh({mesh.positions}, mesh.triangles);
    builder.commit();
    for (const Strategy strategy : {Strategy::bsdf_sampling, Strategy::mis}) {
        Shot shot = shot_from({0.0, 0.5, 4.0}, {0.0, 0.0, 0.0}, 40.0);
        // With bsdf sampling every sample has weight one: no noise at all.
        const bool exact = strategy == Strategy::bsdf_sampling;
        shot.settings.samples = exact ? 16 : 1024;
        shot.settings.strategy = strategy;
        const Film film = shot(builder.world);
        double worst = 0.0;
        for (const float p : find_layer(film, "beauty")->values) worst = std::max(worst, std::abs(p - 1.0));
        std::printf("[ furnace ] white sphere, %s: worst pixel off by %.1e, mean by %.1e\n",
                    exact ? "shader samples" : "mis", worst, std::abs(mean_of(film, "beauty") - 1.0));
        EXPECT_LT(worst, exact ? 1e-6 : 2e-2); // mis: 4 sigma of 1024 samples
        EXPECT_NEAR(mean_of(film, "beauty"), 1.0, exact ? 1e-6 : 3e-4);
    }
}

// White hair fibres: all energy leaves, through the fibres and after many bounces.
TEST(Furnace, WhiteHairInWhiteSkyIsWhite) {
    for (const MarramShape shape : {MARRAM_ROUND, MARRAM_RIBBON}) {
        WorldBuilder builder;
        std::vector<Cv> cvs;
        for (int c = 0; c < 60; ++c)
            for (int i = 0; i < 4; ++i)
                cvs.push_back(
                    Cv(0.02 * (c - 30) + 0.03 * i, 0.3 * (i - 1.5), 0.05 * (c % 7) + 0.02 * i * i, 0.012));
        builder.curves({cvs}, 4, shape, MARRAM_BSPLINE);
        Shot shot = shot_from({0.0, 0.0, 3.0}, {0.0, 0.0, 0.0}, 12.0);
        shot.materials = {testing::material_of("hair", {{"color", "1"}})};
        shot.settings.samples = 64;
        shot.settings.max_depth = 500;
        const Film film = shot(builder.commit());
        std::printf("[ furnace ] white hair, %s: mean %.5f, alpha %.3f\n",
                    shape == MARRAM_ROUND ? "round" : "ribbon", mean_of(film, "beauty"),
                    mean_of(film, "alpha"));
        EXPECT_NEAR(mean_of(film, "beauty"), 1.0, 5e-3);
        EXPECT_GT(mean_of(film, "alpha"), 0.3);
    }
}

// Irradiance at a point straight below the centre of a parallel square of side 2a at height z: F of its four
// corner rectangles (Howell, "A Catalog of Radiation Heat Transfer", B-3).
double square_form_factor(double a, double z) {
    const double x = a / z, s = std::sqrt(1.0 + x * x);
    return 4.0 / (2.0 * pi) * 2.0 * (x / s * std::atan(x / s));
}

// Views the origin of the plane y = 0 from nearby with a narrow field of view, so that all pixels see the
// same point.
Shot probe() {
    Shot shot = shot_from({1.0, 0.4, 0.0}, {0.0, 0.0, 0.0}, 0.05);
    shot.width = shot.height = 4;
    shot.materials = {diffuse({0.5F, 0.25F, 0.75F}), diffuse(Vec3f::Zero())};
    return shot;
}

void add_floor(WorldBuilder& builder) {
    const Triangles floor = testing::quad({-1.5, 0.0, 1.5}, {3.0, 0.0, 0.0}, {0.0, 0.0, -3.0});
    builder.mesh({floor.positions}, floor.triangles);
}

// A triangle looks the same whichever way it and its vertex normals are wound, and no light comes through.
TEST(Sides, WindingAndNormalsMayDisagree) {
    const Triangles mesh = ball();
    const auto take = [&](bool reversed, bool against, const Vec3d& from) {
        WorldBuilder builder;
        auto triangles = mesh.triangles;
        auto normals = mesh.normals;
        for (size_t t = 0; t < triangles.size() && reversed; t += 3)
            std::swap(triangles[t][1], triangles[t][2]);
        if (against)
            for (Vec3f& n : normals) n = -n;
        builder.mesh({mesh.positions}, triangles, 0, -1, {normals});
        Shot shot = shot_from(from, {0.3, 0.1, 0.0}, 40.0);
        shot.materials = {diffuse(Vec3f::Constant(0.5F))};
        shot.settings.samples = 4;
        shot.layers = {"beauty", "normal"};
        return shot(builder.commit());
    };
    const Vec3d outside(0.0, 0.5, 4.0), inside(-0.2, 0.0, 0.1);
    const Film right = take(false, false, outside);
    EXPECT_GT(mean_of(right, "beauty"), 0.5);
    for (const auto& [reversed, against] : {std::pair(true, false), {false, true}, {true, true}}) {
        const Film film = take(reversed, against, outside);
        for (const char* layer : {"beauty", "normal"}) {
            const std::vector<float>&a = find_layer(right, layer)->values,
                  &b = find_layer(film, layer)->values;
            double worst = 0.0;
            for (size_t i = 0; i < a.size(); ++i)
                worst = std::max(worst, std::abs(double(a[i]) - double(b[i])));
            EXPECT_LT(worst, 1e-4) << layer << reversed << against;
        }
        EXPECT_EQ(mean_of(take(reversed, against, inside), "beauty"), 0.0) << reversed << against;
    }
}

// A floor that catches the shadow of a square above it: alpha is the share of the sky that the square covers,
// RGB is 0.
TEST(ShadowCatcher, AlphaIsTheShareOfLightThatIsBlocked) {
    WorldBuilder builder;
    add_floor(builder);
    builder.world.meshes[0].shadow_catcher = true;
    const Triangles roof = testing::quad({-0.5, 0.8, -0.5}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0});
    builder.mesh({roof.positions}, roof.triangles, 1);
    Shot shot = probe();
    SkyLight sky;
    sky.visible = false;
    shot.lights = {sky};
    shot.settings.samples = 1024;
    const Film film = shot(builder.commit());
    EXPECT_EQ(mean_of(film, "beauty"), 0.0);
    EXPECT_NEAR(mean_of(film, "alpha"), square_form_factor(0.5, 0.8), 1e-2);
    // Nothing is above: no shadow. Without the floor the film is empty: the light is not seen.
    WorldBuilder bare;
    add_floor(bare);
    bare.world.meshes[0].shadow_catcher = true;
    EXPECT_EQ(mean_of(shot(bare.commit()), "alpha"), 0.0);
    WorldBuilder empty;
    EXPECT_EQ(mean_of(shot(empty.commit()), "beauty"), 0.0);
}

class Strategies : public ::testing::TestWithParam<Strategy> {};
INSTANTIATE_TEST_SUITE_P(All, Strategies,
                         ::testing::Values(Strategy::mis, Strategy::light_sampling, Strategy::bsdf_sampling),
                         ::testing::PrintToStringParamName());

TEST_P(Strategies, PlaneUnderEmittingSquare) {
    WorldBuilder builder;
    add_floor(builder);
    const Triangles lamp =
        testing::quad({-0.5, 0.8, -0.5}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0}); // u x v: downwards
    builder.mesh({lamp.positions}, lamp.triangles, 1, 0);
    const Triangles turned = testing::quad({-2.0, 0.5, -0.5}, {0.0, 0.0, 1.0}, {0.5, 0.0, 0.0});
    builder.mesh({turned.positions}, turned.triangles, 1, 0); // emits upwards: none of it arrives
    Shot shot = probe();
    shot.lights = {MeshLight{Vec3f(4.0F, 4.0F, 4.0F)}};
    shot.settings.samples = 1024;
    shot.settings.strategy = GetParam();
    const Film film = shot(builder.commit());
    const double expected = 4.0 * square_form_factor(0.5, 0.8) * 0.5;
    EXPECT_NEAR(mean_of(film, "beauty") / expected, 1.0, GetParam() == Strategy::bsdf_sampling ? 2e-2 : 5e-3);
}

// A lamp that shrinks to a point at mid-shutter and grows again: its area is 1, 0, 1 at the keys and
// quadratic between, so the mean is a third. Scaled about its centre, it is far enough away to count by its
// area.
TEST_P(Strategies, LampWithoutAreaAtMidShutter) {
    WorldBuilder builder({0.0, 0.5, 1.0});
    add_floor(builder);
    std::vector<std::vector<Vec3f>> positions;
    for (const double side : {0.2, 0.0, 0.2})
        positions.push_back(
            testing::quad({-0.5 * side, 0.8, -0.5 * side}, {side, 0.0, 0.0}, {0.0, 0.0, side}).positions);
    builder.mesh(positions, {{0, 1, 2}, {0, 2, 3}}, 1, 0);
    Shot shot = probe();
    shot.lights = {MeshLight{Vec3f(100.0F, 100.0F, 100.0F)}};
    shot.settings.samples = 4096;
    shot.settings.strategy = GetParam();
    double expected = 0.0; // Simpson's rule over the half-width
    constexpr int steps = 64;
    for (int i = 0; i <= steps; ++i)
        expected += (i == 0 || i == steps ? 1.0
                     : i % 2 == 1         ? 4.0
                                          : 2.0) *
                    square_form_factor(0.1 * i / steps, 0.8) / (3.0 * steps);
    const Film film = shot(builder.commit());
    EXPECT_NEAR(mean_of(film, "beauty") / (100.0 * expected * 0.5), 1.0,
                GetParam() == Strategy::bsdf_sampling ? 0.1 : 1e-2);
}

TEST_P(Strategies, PlaneUnderEmittingSphere) {
    WorldBuilder builder;
    add_floor(builder);
    const double radius = 0.3, height = 1.2;
    const Triangles lamp = testing::sphere({0.0, height, 0.0}, radius, 128, 64);
    builder.mesh({lamp.positions}, lamp.triangles, 1, 0);
    Shot shot = probe();
    shot.lights = {MeshLight{Vec3f(10.0F, 10.0F, 10.0F)}};
    shot.settings.samples = 1024;
    shot.settings.strategy = GetParam();
    const Film film = shot(builder.commit());
    const double expected = 10.0 * (radius / height) * (radius / height) * 0.5; // F = sin^2 of the half-angle
    EXPECT_NEAR(mean_of(film, "beauty") / expected, 1.0, GetParam() == Strategy::bsdf_sampling ? 4e-2 : 1e-2);
}

TEST_P(Strategies, BigSunOnPlane) {
    WorldBuilder builder;
    add_floor(builder);
    Shot shot = probe();
    shot.lights = {SunLight{{0.0, 2.0, 1.5}, 30.0 * degree, Vec3f(2.0F, 2.0F, 2.0F)}};
    shot.settings.samples = 1024;
    shot.settings.strategy = GetParam();
    const Film film = shot(builder.commit());
    EXPECT_NEAR(mean_of(film, "beauty") / (2.0 * 0.8 / pi * 0.5), 1.0, 3e-2);
}

TEST(Sun, GivesItsIrradianceAtAnyAngle) {
    WorldBuilder builder;
    add_floor(builder);
    builder.commit();
    for (const double angle : {0.0, 1e-7, 1e-5, 0.533 * degree, 5.0 * degree}) {
        Shot shot = probe();
        shot.lights = {SunLight{{0.0, 2.0, 1.5}, angle, Vec3f(2.0F, 2.0F, 2.0F)}};
        shot.settings.samples = 64;
        EXPECT_NEAR(mean_of(shot(builder.world), "beauty") / (2.0 * 0.8 / pi * 0.5), 1.0, 2e-3) << angle;
    }
}

EnvironmentLight image_of(const SkyLight& sky, uint32_t width) {
    EnvironmentLight map;
    map.image.width = width;
    map.image.height = width / 2;
    for (uint32_t y = 0; y < map.image.height; ++y)
        for (uint32_t x = 0; x < map.image.width; ++x)
            map.image.pixels.edit().push_back(sky_radiance(
                sky, Vec3f(0.0F, static_cast<float>(std::cos(pi * (y + 0.5) / map.image.height)), 0.0F)));
    return map;
}

TEST(Environment, LightsLikeTheSkyItShows) {
    SkyLight sky;
    sky.zenith = {0.2F, 0.4F, 0.9F};
    sky.horizon = {0.9F, 0.8F, 0.7F};
    sky.ground = {0.2F, 0.15F, 0.1F};
    WorldBuilder builder;
    const Triangles mesh = ball();
    builder.mesh({mesh.positions}, mesh.triangles, 0, -1, {mesh.normals});
    builder.commit();
    Shot shot = shot_from({0.0, 0.5, 4.0}, {0.0, 0.0, 0.0}, 20.0);
    shot.width = shot.height = 8;
    shot.materials = {diffuse({0.6F, 0.6F, 0.6F})};
    shot.settings.samples = 256;
    shot.lights = {sky};
    const Film by_sky = shot(builder.world);
    shot.lights = {image_of(sky, 512)};
    const Film by_image = shot(builder.world);
    for (size_t i = 0; i < by_sky.layers[0].values.size(); ++i)
        EXPECT_NEAR(by_sky.layers[0].values[i], by_image.layers[0].values[i], 0.02);
    EXPECT_NEAR(mean_of(by_sky, "beauty"), mean_of(by_image, "beauty"), 1e-3);
}

// All strategies and lights together, on surfaces and fibres, give the same mean.
TEST(Strategy, AllAgree) {
    WorldBuilder builder;
    add_floor(builder);
    const Triangles lamp = testing::sphere({0.5, 0.9, 0.3}, 0.25, 16, 8);
    builder.mesh({lamp.positions}, lamp.triangles, 0, 1);
    std::vector<Cv> cvs;
    for (int c = 0; c < 20; ++c)
        for (int i = 0; i < 4; ++i)
            cvs.push_back(Cv(0.02 * (c - 10) + 0.02 * i, 0.15 * i, 0.02 * (c % 5), 0.008));
    builder.curves({cvs}, 4, MARRAM_ROUND, MARRAM_BSPLINE, 1);
    builder.commit();
    Shot shot = shot_from({0.5, 0.5, 1.5}, {0.0, 0.2, 0.0}, 30.0);
    shot.materials = {diffuse({0.5F, 0.5F, 0.5F}), testing::material_of("hair")};
    SkyLight sky;
    sky.ground = {0.1F, 0.1F, 0.1F};
    sky.zenith = {0.3F, 0.4F, 0.9F};
    shot.lights = {sky, MeshLight{Vec3f(3.0F, 3.0F, 3.0F)},
                   SunLight{{0.3, 1.0, 0.5}, 20.0 * degree, Vec3f::Ones()}};
    shot.settings.samples = 2500;
    std::array<double, 3> means{};
    for (int i = 0; i < 3; ++i) {
        shot.settings.strategy = static_cast<Strategy>(i);
        means[static_cast<size_t>(i)] = mean_of(shot(builder.world), "beauty");
    }
    std::printf("[ unbiased ] mis %.5f, lights only %.5f, shaders only %.5f\n", means[0], means[1], means[2]);
    EXPECT_NEAR(means[1] / means[0], 1.0, 5e-3);
    EXPECT_NEAR(means[2] / means[0], 1.0, 5e-3);
}

// Roulette on shadow rays, from a film's fifth sample on, saves rays and keeps the mean: many short renders
// do not use it.
TEST(Roulette, OnLightsSavesRaysAndKeepsTheMean) {
    WorldBuilder builder;
    add_floor(builder);
    std::vector<Cv> cvs;
    for (int c = 0; c < 400; ++c)
        for (int i = 0; i < 4; ++i)
            cvs.push_back(Cv(0.05 * (c % 20 - 10) + 0.02 * i, 0.15 * i, 0.05 * (c / 20 - 10), 0.012));
    builder.curves({cvs}, 4, MARRAM_ROUND, MARRAM_BSPLINE, 1);
    builder.commit();
    Shot shot = shot_from({0.5, 0.9, 1.8}, {0.0, 0.2, 0.0}, 30.0);
    shot.width = shot.height = 16;
    shot.materials = {diffuse({0.5F, 0.5F, 0.5F}), testing::material_of("hair")};
    shot.lights = {SkyLight{}, SunLight{{0.3, 1.0, 0.5}, 20.0 * degree, Vec3f::Ones()}};
    struct Result {
        double mean, variance, rays; // shadow rays a sample
    };
    const auto render = [&](int renders, uint32_t samples) {
        double sum = 0.0, squares = 0.0, rays = 0.0;
        shot.settings.samples = samples;
        for (int i = 0; i < renders; ++i) {
            ++shot.settings.seed;
            const double mean = mean_of(shot(builder.world), "beauty");
            sum += mean;
            squares += mean * mean;
            rays += double(shot.stats.rays.occluded);
        }
        return Result{sum / renders, variance_of_mean(sum, squares, renders),
                      rays / (renders * double(samples) * 256.0)};
    };
    const Result without = render(256, 4), with = render(16, 64);
    const double deviation = std::sqrt(without.variance + with.variance);
    std::printf(
        "[ roulette ] rays to lights a sample: %.3f, without %.3f; mean %.5f, without %.5f, +- %.5f\n",
        with.rays, without.rays, with.mean, without.mean, deviation);
    EXPECT_NEAR(with.mean, without.mean, 4.0 * deviation);
    EXPECT_LT(deviation, 3e-3 * without.mean);
    EXPECT_LT(with.rays, 0.7 * without.rays);
    EXPECT_LT(with.variance * 64 * 16, 1.5 * without.variance * 4 * 256);
}

} // namespace
} // namespace marram
