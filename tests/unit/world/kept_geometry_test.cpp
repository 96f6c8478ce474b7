// SPDX-License-Identifier: Apache-2.0
// What is kept from frame to frame: every frame has the same bits as when it is built alone, and static
// geometry is not rebuilt.
#include "build_scene.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace marram::testing {
namespace {

CameraSamples camera_from(double x) {
    CameraSamples camera;
    camera.times = {0.0};
    camera.positions = {{x, 2.5, 0.0}};
    camera.directions = {Vec3d(1.0, -0.3, 0.0).normalized()};
    camera.ups = {Vec3d(0.3, 1.0, 0.0).normalized()};
    camera.fov = 0.8;
    camera.width = 320;
    camera.height = 180;
    return camera;
}

std::string dunes(const std::string& height, const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"terrain\"\nname = \"dunes\"\nsize = [32, 24]\ncell = 0.5\n" + more +
           "[[procedural.layer]]\ntype = \"noise\"\namplitude = 0.5\nwavelength = 9\n"
           "[[procedural.layer]]\ntype = \"flat\"\ntarget = \"sand\"\nheight = " +
           height + "\n[[procedural.layer]]\ntype = \"ripples\"\nwavelength = 0.2\nheight = 0.02\nseed = 3\n";
}

const std::string resting_ball =
    mesh("ball", "sphere", "transform = { keys = [{ frame = 1, translate = [0, 2, 0] }] }");
const std::string rolling_ball = mesh(
    "ball", "sphere",
    "transform = { keys = [{ frame = 1, translate = [0, 2, 0] }, { frame = 9, translate = [4, 2, 0] }] }");
const std::string some_wind = "\n[wind]\nspeed = 6\n";

// Consecutive frames, each with what was kept from the one before.
struct Sequence {
    TestScene scene;
    KeptGeometry kept{};

    explicit Sequence(const std::string& text) : scene(text) {}
    World frame(double number, double camera = -6.0) {
        scene.settings.frame = number;
        scene.settings.camera = camera_from(camera);
        scene.settings.attributes = {"ripples", "ripple_wave", "sand"};
        return build_world(scene.geometry, scene.settings, scene.cancel, scene.progress, scene.stats = {},
                           std::exchange(kept, {}));
    }
};

World alone(const std::string& text, double number, double camera = -6.0) {
    return Sequence(text).frame(number, camera);
}

void expect_same(const MeshGeometry& a, const MeshGeometry& b) {
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.roles, b.roles);
    EXPECT_EQ(a.triangles, b.triangles);
    EXPECT_EQ(a.positions, b.positions);
    EXPECT_EQ(a.normals, b.normals);
    EXPECT_EQ(a.uvs, b.uvs);
    ASSERT_EQ(a.attributes.size(), b.attributes.size());
    for (size_t i = 0; i < a.attributes.size(); ++i)
        EXPECT_EQ(a.attributes[i].values, b.attributes[i].values);
    ASSERT_EQ(a.grids.size(), b.grids.size());
    for (size_t i = 0; i < a.grids.size(); ++i) EXPECT_EQ(a.grids[i].values, b.grids[i].values);
}

void expect_same(const World& a, const World& b) {
    ASSERT_EQ(a.meshes.size(), b.meshes.size());
    for (uint32_t id = 0; id < a.meshes.size(); ++id) {
        expect_same(a.meshes[id], b.meshes[id]);
        expect_same(a.growth_surface(id), b.growth_surface(id));
    }
    ASSERT_EQ(a.curves.size(), b.curves.size());
    for (size_t c = 0; c < a.curves.size(); ++c) {
        ASSERT_EQ(a.curves[c].vertices.size(), b.curves[c].vertices.size());
        const size_t floats = 4 * a.curves[c].layout().vertex_count();
        ASSERT_EQ(floats, 4 * b.curves[c].layout().vertex_count());
        for (size_t t = 0; t < a.curves[c].vertices.size(); ++t)
            EXPECT_TRUE(std::equal(a.curves[c].vertices[t], a.curves[c].vertices[t] + floats,
                                   b.curves[c].vertices[t]));
    }
    EXPECT_EQ(a.bounds.min(), b.bounds.min());
    EXPECT_EQ(a.bounds.max(), b.bounds.max());
}

TEST(KeptGeometry, WhatRestsIsTakenOver) {
    const std::string text = some_wind + resting_ball + dunes("1") + groom("grass", "dunes");
    Sequence sequence(text);
    World first = sequence.frame(1);
    const Vec3f *sphere = first.meshes[0].positions[0].data(), *seen = first.meshes[1].positions[0].data(),
                *grown = first.growth_surface(1).positions[0].data();
    const RTCScene colliders = first.colliders.get();
    sequence.kept = kept_geometry(std::move(first));
    const World second = sequence.frame(2);
    EXPECT_EQ(second.meshes[0].positions[0].data(), sphere);
    EXPECT_EQ(second.meshes[1].positions[0].data(), seen);
    EXPECT_EQ(second.growth_surface(1).positions[0].data(), grown);
    EXPECT_EQ(second.colliders.get(), colliders);
    expect_same(second, alone(text, 2));
    EXPECT_EQ(sequence.scene.stats.triangles,
              second.meshes[0].triangles.size() + second.meshes[1].triangles.size());
}

TEST(KeptGeometry, AnotherCameraGetsARenderMeshOfItsOwn) {
    const std::string text = some_wind + dunes("1") + groom("grass", "dunes");
    Sequence sequence(text);
    World first = sequence.frame(1);
    const Vec3f* grown = first.growth_surface(0).positions[0].data();
    sequence.kept = kept_geometry(std::move(first));
    World second = sequence.frame(2, -3.0);
    EXPECT_EQ(second.growth_surface(0).positions[0].data(), grown);
    expect_same(second, alone(text, 2, -3.0));
    sequence.kept = kept_geometry(std::move(second));
    expect_same(sequence.frame(3, -3.0), alone(text, 3, -3.0));
}

// The ball is a moving mesh of the scene; the ruin is sand around it.
TEST(KeptGeometry, WhatMovesIsMadeAnew) {
    for (const std::string& text : {some_wind + rolling_ball + dunes("1") + groom("grass", "dunes"),
                                    some_wind + rolling_ball + dunes("1", "") +
                                        "[[procedural.layer]]\ntype = \"ruin\"\nmesh = \"ball\"\n"}) {
        Sequence sequence(text);
        for (const double frame : {1.0, 2.0, 5.0, 1.0}) {
            World world = sequence.frame(frame);
            expect_same(world, alone(text, frame));
            sequence.kept = kept_geometry(std::move(world));
        }
    }
}

const std::string evolving_grass =
    some_wind +
    "\n[[procedural]]\ntype = \"terrain\"\nname = \"dunes\"\nsize = [32, 24]\ncell = 1\n"
    "wind.speed = 12\n[[procedural.layer]]\ntype = \"flat\"\ntarget = \"sand\"\nheight = 1\n"
    "[[procedural.layer]]\ntype = \"noise\"\ntarget = \"sand\"\namplitude = 0.3\nwavelength = 8\n"
    "[[procedural.layer]]\ntype = \"dune_solver\"\ndays_per_frame = 0.5\n" +
    groom("grass", "dunes",
          "density = 2\ndensity_by = [{ attribute = \"sand\", ramp = [[0.9, 0], [1.3, 1]] }]");

// Strands appear and vanish with the sand below them; those that stay are the same.
TEST(KeptGeometry, AnEvolvingTerrainIsThatOfItsFrame) {
    const std::string& text = evolving_grass;
    Sequence sequence(text);
    std::vector<uint64_t> counts;
    for (const double frame : {1.0, 3.0, 3.0, 2.0}) {
        World world = sequence.frame(frame);
        expect_same(world, alone(text, frame));
        counts.push_back(world.curves.at(0).curve_count);
        sequence.kept = kept_geometry(std::move(world));
    }
    EXPECT_GT(counts[0], 100u);
    EXPECT_NE(counts[1], counts[0]);
}

// Random gusts start across the bounds of the meshes in the first frame rendered. An evolving terrain has
// others later: that is reported, once, and what the message says to give makes each frame that of itself
// alone.
TEST(KeptGeometry, GustsOnAnEvolvingTerrainAreReported) {
    const auto text = [](const std::string& start) {
        return evolving_grass + "wind.gusts = { num_gusts = 5, radius_range = [3, 5], period = 24" + start +
               " }\n";
    };
    const auto warnings = [](const Sequence& sequence) {
        return std::ranges::count_if(sequence.scene.stats.warnings, [](const Problem& warning) {
            return to_string(warning).find("give wind.gusts.center = [") != std::string::npos;
        });
    };
    Sequence automatic(text(""));
    std::vector<std::ptrdiff_t> counts;
    for (const double frame : {1.0, 3.0, 5.0}) {
        World world = automatic.frame(frame);
        counts.push_back(warnings(automatic));
        automatic.kept = kept_geometry(std::move(world));
    }
    EXPECT_EQ(counts, (std::vector<std::ptrdiff_t>{0, 1, 0}));
    const std::string given = text(", center = [0, 1, 0], extent = [30, 3], distance = 20");
    Sequence fixed(given);
    for (const double frame : {1.0, 3.0}) {
        World world = fixed.frame(frame);
        EXPECT_EQ(warnings(fixed), 0);
        expect_same(world, alone(given, frame));
        fixed.kept = kept_geometry(std::move(world));
    }
}

// The same for strands guided by such a terrain's strands, and for a file's strands bound to it.
TEST(KeptGeometry, WhatDependsOnAnEvolvingTerrainIsThatOfItsFrame) {
    const std::string text =
        evolving_grass + mesh("lawn", "plane") +
        "\n[[procedural]]\ntype = \"groom\"\nname = \"led\"\non = \"lawn\"\nwidth = 0.01\ncount = 50\n"
        "guides = { curves = \"grass\" }\n"
        "[[curves]]\ntype = \"points\"\nname = \"reed\"\npoints = [[1, 1, 1], [1, 1.5, 1], [1.2, 2, 1]]\n"
        "[[procedural]]\ntype = \"strands\"\nname = \"reeds\"\ncurves = \"reed\"\non = \"dunes\"\nwidth = "
        "0.01\n";
    Sequence sequence(text);
    for (const double frame : {1.0, 3.0, 2.0}) {
        World world = sequence.frame(frame);
        expect_same(world, alone(text, frame));
        sequence.kept = kept_geometry(std::move(world));
    }
}

TEST(KeptGeometry, NothingOldIsLeftAfterAnUpdate) {
    const auto text = [](const std::string& height) {
        return some_wind + resting_ball + dunes(height) + groom("grass", "dunes");
    };
    Sequence sequence(text("1"));
    for (const char* height : {"1", "2", "1", "1"}) {
        sequence.scene.update(text(height));
        World world = sequence.frame(1);
        expect_same(world, alone(text(height), 1));
        sequence.kept = kept_geometry(std::move(world));
    }
    // A mesh whose visibility changes: its ray mask is Embree's.
    sequence.scene.geometry.meshes[0].roles = MARRAM_CASTS_SHADOWS;
    const World world = sequence.frame(1);
    const std::string unseen =
        mesh("ball", "sphere",
             "transform = { keys = [{ frame = 1, translate = [0, 2, 0] }] }\ncollides = false\n"
             "shelters = false\nseen_by_camera = false");
    expect_same(world, alone(some_wind + unseen + dunes("1") + groom("grass", "dunes"), 1));
}

// Nothing is kept for a library that does not report what stays the same.
TEST(KeptGeometry, WithoutAVersionNothingIsKept) {
    const std::string text =
        "\n[[procedural]]\ntype = \"hill\"\nname = \"dunes\"\n" + groom("grass", "dunes");
    Sequence sequence(text);
    KeptGeometry kept = kept_geometry(sequence.frame(1));
    EXPECT_TRUE(kept.growth_surfaces.empty());
    EXPECT_TRUE(kept.collider_scenes.empty());
    EXPECT_TRUE(kept.device);
}

TEST(KeptGeometry, NoSceneOfCollidersWhereNothingIsTraced) {
    const World world = alone(resting_ball + dunes("1"), 1);
    EXPECT_TRUE(world.collider_scenes.empty());
    EXPECT_GT(world.bounds.max().x(), 10.0F);
}

} // namespace
} // namespace marram::testing
