// SPDX-License-Identifier: Apache-2.0
// The film's content: silhouettes, motion, layers. It depends on the scene alone.
#include "tests/unit/render/world_builder.h"
#include "tests/unit/shaders/default_params.h"

#include "core/math/problem.h"
#include "core/render/integrator.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

namespace marram {
namespace {

using testing::Cv;
using testing::Triangles;
using testing::WorldBuilder;

const std::vector<Material> materials = {testing::material_of("diffuse")};

// A camera at +z, distant enough to be orthographic to 1e-5. Its image spans `width` at the origin's depth.
Camera far_camera(double width) {
    const double distance = 3000.0 * width;
    Camera camera;
    camera.poses = {look_at({0.0, 0.0, distance}, Vec3d::Zero(), Vec3d::UnitY())};
    camera.vertical_fov = 2.0 * std::atan(0.5 * width / distance);
    return camera;
}

RenderSettings plain(uint32_t samples) {
    RenderSettings settings;
    settings.samples = samples;
    settings.max_depth = 2;
    settings.filter = {FilterKind::box, 0.5};
    return settings;
}

Film take(const World& world, const Camera& camera, const RenderSettings& settings, uint32_t width,
          uint32_t height, const std::vector<std::string>& layers,
          const std::vector<LightDescription>& lights = {SkyLight{}}) {
    Film film = make_film(width, height, layers, world);
    const RenderStats stats = render(world, Lights(lights, world), materials, camera, settings, film);
    EXPECT_EQ(stats.rays.invalid, 0U);
    return film;
}

double mean_of(const FilmLayer& layer) {
    double sum = 0.0;
    for (const float p : layer.values) sum += p;
    return sum / static_cast<double>(layer.values.size());
}

// The area that a strand of length 1 covers from the side.
double drawn_area(MarramShape shape, MarramBasis basis, double root, double tip) {
    WorldBuilder builder;
    std::vector<Cv> cvs;
    for (int i = 0; i < 6; ++i) cvs.push_back(Cv(-0.5 + 0.2 * i, 0.013, 0.0, root + (tip - root) * i / 5.0));
    builder.curves({cvs}, 6, shape, basis, 0, Vec3f::UnitZ());
    const Film film = take(builder.commit(), far_camera(1.2), plain(16), 128, 128, {"alpha"});
    return mean_of(film.layers[0]) * 1.2 * 1.2;
}

TEST(Silhouette, IsAsWideAsTheRadiiSay) {
    for (const MarramShape shape : {MARRAM_ROUND, MARRAM_RIBBON, MARRAM_ORIENTED_RIBBON})
        for (const MarramBasis basis : {MARRAM_BSPLINE, MARRAM_CATMULL_ROM}) {
            EXPECT_NEAR(drawn_area(shape, basis, 0.04, 0.04), 0.08, 0.08 * 5e-3) << shape << basis;
            // The vertex after the tip has radius -0.01; the tip itself has 0.
            EXPECT_NEAR(drawn_area(shape, basis, 0.04, 0.0), 0.04, 0.04 * 5e-3) << shape << basis;
            EXPECT_NEAR(drawn_area(shape, basis, 0.04, 0.01), 0.05, 0.05 * 5e-3) << shape << basis;
        }
}

// A square of side 1 that moves right by 1: alpha rises and falls linearly along its path.
TEST(Motion, SquareLeavesTheAnalyticTrace) {
    WorldBuilder builder({0.0, 0.25, 0.5});
    std::vector<std::vector<Vec3f>> positions;
    for (const double x : {-1.0, -0.5, 0.0})
        positions.push_back(testing::quad({x, -0.5, 0.0}, Vec3d::UnitX(), Vec3d::UnitY()).positions);
    builder.mesh(positions, {{0, 1, 2}, {0, 2, 3}});
    const Film film = take(builder.commit(), far_camera(2.5), plain(256), 50, 50, {"alpha"});
    for (uint32_t column = 0; column < 50; ++column) {
        const double x = -1.25 + 2.5 * (column + 0.5) / 50.0;
        const double expected = std::clamp(1.0 - std::abs(x), 0.0, 1.0);
        EXPECT_NEAR(film.layers[0].values[25 * 50 + column], expected, 0.025) << column;
    }
}

// A fibre that moves up by its own diameter: alpha rises over the first diameter and is full in the middle
// only for an instant.
TEST(Motion, FibreLeavesTheAnalyticTrace) {
    WorldBuilder builder({0.0, 1.0});
    std::vector<std::vector<Cv>> cvs(2);
    for (int t = 0; t < 2; ++t)
        for (int i = 0; i < 4; ++i) cvs[static_cast<size_t>(t)].push_back(Cv(i - 1.5, t - 1.0, 0.0, 0.5));
    builder.curves(cvs, 4, MARRAM_ROUND, MARRAM_BSPLINE);
    const Film film = take(builder.commit(), far_camera(2.5), plain(256), 50, 50, {"alpha"});
    for (uint32_t row = 0; row < 50; ++row) {
        const double y = 1.25 - 2.5 * (row + 0.5) / 50.0;
        const double expected = std::clamp(1.0 - std::abs(y + 0.5), 0.0, 1.0);
        EXPECT_NEAR(film.layers[0].values[row * 50 + 25], expected, 0.025) << row;
    }
}

TEST(Motion, MovingCameraBlursAResting) {
    WorldBuilder builder;
    const Triangles square = testing::quad({-0.5, -0.5, 0.0}, Vec3d::UnitX(), Vec3d::UnitY());
    builder.mesh({square.positions}, square.triangles);
    Camera camera = far_camera(2.5);
    camera.poses.push_back(camera.poses[0]);
    camera.poses[0].position.x() -= 0.5;
    camera.poses[1].position.x() += 0.5;
    const Film film = take(builder.commit(), camera, plain(256), 50, 50, {"alpha"});
    for (uint32_t column = 0; column < 50; ++column) {
        const double x = -1.25 + 2.5 * (column + 0.5) / 50.0;
        EXPECT_NEAR(film.layers[0].values[25 * 50 + column], std::clamp(1.0 - std::abs(x), 0.0, 1.0), 0.025);
    }
}

WorldBuilder tuft() {
    WorldBuilder builder({0.0, 0.5});
    const Triangles floor = testing::quad({-1.0, 0.0, 1.0}, {2.0, 0.0, 0.0}, {0.0, 0.0, -2.0});
    builder.mesh({floor.positions}, floor.triangles);
    std::vector<std::vector<Cv>> cvs(2);
    for (int t = 0; t < 2; ++t)
        for (int c = 0; c < 40; ++c)
            for (int i = 0; i < 5; ++i)
                cvs[static_cast<size_t>(t)].push_back(
                    Cv(0.03 * (c - 20) + 0.02 * t * i, 0.15 * i, 0.05 * (c % 5), 0.008 * (1.0 - 0.2 * i)));
    builder.curves(cvs, 5, MARRAM_ROUND, MARRAM_BSPLINE);
    CurveGeometry& curves = builder.world.curves[0];
    AttributeValues id{"id", 1, MARRAM_PER_CURVE, {}}, position{"position", 3, MARRAM_PER_CV, {}};
    for (int c = 0; c < 40; ++c) id.values.push_back(static_cast<float>(c));
    for (const Cv& cv : cvs[0])
        for (int k = 0; k < 3; ++k) position.values.push_back(static_cast<float>(cv[k]));
    curves.attributes = {id, position};
    builder.commit();
    return builder;
}

TEST(Layers, CarryWhatTheyAreNamedAfter) {
    const WorldBuilder builder = tuft();
    Camera camera;
    camera.poses = {look_at({0.0, 0.4, 3.0}, {0.0, 0.3, 0.0}, Vec3d::UnitY())};
    camera.vertical_fov = 20.0 * degree;
    RenderSettings settings = plain(1);
    settings.filter = {FilterKind::box, 1e-6}; // through the pixels' centres
    const Film film = take(builder.world, camera, settings, 64, 64,
                           {"beauty", "alpha", "albedo", "normal", "depth", "strand_u", "id", "position"});
    EXPECT_EQ(find_layer(film, "position")->channels, 3U);
    size_t strands = 0;
    for (size_t i = 0; i < 64 * 64; ++i) {
        const float u = find_layer(film, "strand_u")->values[i], alpha = find_layer(film, "alpha")->values[i];
        EXPECT_EQ(alpha == 0.0F, find_layer(film, "depth")->values[i] == 0.0F);
        if (u == 0.0F) continue;
        ++strands;
        EXPECT_NEAR(find_layer(film, "position")->values[3 * i + 1], 0.6 * u, 1e-4);
        EXPECT_NEAR(find_layer(film, "position")->values[3 * i],
                    0.03 * (find_layer(film, "id")->values[i] - 20.0), 1e-4);
        const Eigen::Map<const Vec3f> normal(find_layer(film, "normal")->values.data() + 3 * i);
        EXPECT_NEAR(normal.norm(), 1.0, 1e-5);
        EXPECT_GT(normal.z(), -0.1);
        EXPECT_NEAR(find_layer(film, "albedo")->values[3 * i], 0.5, 1e-6);
        EXPECT_NEAR(find_layer(film, "depth")->values[i], 3.0, 0.4);
    }
    EXPECT_GT(strands, 300U);
    EXPECT_EQ(layer_channels("shield", builder.world), 0U);
    EXPECT_THROW(make_film(4, 4, std::vector<std::string>{"shield"}, builder.world), InputError);
}

TEST(Determinism, SameBitsAtAnyThreadCountAndTileSize) {
    const WorldBuilder builder = tuft();
    Camera camera;
    camera.poses = {look_at({0.0, 0.5, 3.0}, {0.0, 0.3, 0.0}, Vec3d::UnitY())};
    camera.lens_radius = 0.01;
    camera.focus_distance = 3.0;
    std::vector<Film> films;
    for (const int threads : {1, 2})
        for (const uint32_t tile : {16U, 7U}) {
            RenderSettings settings;
            settings.samples = 21;
            settings.tile = tile;
            tbb::task_arena arena(threads);
            arena.execute([&] {
                films.push_back(take(builder.world, camera, settings, 40, 30, {"beauty", "depth", "id"},
                                     {SkyLight{}, SunLight{}}));
            });
        }
    for (const Film& film : films)
        for (size_t i = 0; i < film.layers.size(); ++i)
            EXPECT_EQ(film.layers[i].values, films[0].layers[i].values);
}

TEST(Cancel, StopsAtOnceAndLeavesWhatIsThere) {
    const WorldBuilder builder = tuft();
    Camera camera;
    camera.poses = {look_at({0.0, 0.5, 3.0}, {0.0, 0.3, 0.0}, Vec3d::UnitY())};
    const std::vector<std::string> layers = {"beauty"};
    Film film = make_film(32, 32, layers, builder.world);
    std::atomic<bool> cancel = true;
    RenderProgress progress;
    progress.cancel = &cancel;
    const std::vector<LightDescription> lights = {SkyLight{}};
    const Lights tables(lights, builder.world);
    RenderStats stats = render(builder.world, tables, materials, camera, RenderSettings{}, film, &progress);
    EXPECT_TRUE(stats.cancelled);
    EXPECT_EQ(progress.samples_done, 0U);
    EXPECT_EQ(film.layers[0].values.size(), 32U * 32U * 3U);
    cancel = false;
    stats = render(builder.world, tables, materials, camera, plain(5), film, &progress);
    EXPECT_FALSE(stats.cancelled);
    EXPECT_EQ(progress.samples_done, 32U * 32U * 5U);
    EXPECT_GE(stats.rays.intersect, 32U * 32U * 5U);
}

TEST(Hit, RefusesRaysThatEmbreeMustNotSee) {
    const WorldBuilder builder = tuft();
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    std::vector<Ray> bad(9);
    bad[0].origin.x() = nan;
    bad[1].direction.y() = inf;
    bad[2].tnear = -1.0F;
    bad[3].time = 1.5F;
    bad[4].time = nan;
    bad[5].tfar = nan;
    bad[6].origin.z() = 1e30F;
    bad[7].tnear = inf;
    bad[8].direction = Vec3f::Zero();
    RayCounts counts;
    for (const Ray& ray : bad) {
        SurfacePoint point;
        EXPECT_FALSE(intersect(builder.world, ray, point, false, &counts));
        EXPECT_FALSE(occluded(builder.world, ray, &counts));
    }
    EXPECT_EQ(counts.invalid, 2 * bad.size());
    EXPECT_EQ(counts.intersect + counts.occluded, 0U);
}

} // namespace
} // namespace marram
