// SPDX-License-Identifier: Apache-2.0
// Strands of a level of detail beside all of them, in worlds as the renderer builds them.
#include "build_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <map>
#include <set>

namespace marram::testing {
namespace {

const std::string field = mesh("ground", "plane", "size = [60, 60]\ndivisions = 40\n");
const std::string grass = "spacing = 0\ndensity = 20\nwidth_variation = 0.3\nseed = 3\ncvs = 4\n";
const std::string wind = "\n[wind]\ndirection = [1, 0, 0]\nspeed = 8\nnoise = { amplitude = 0.3 }\n";

void look_from(TestScene& scene, const Vec3d& position) {
    CameraSamples camera;
    camera.times = {scene.settings.frame};
    camera.positions = {position};
    camera.directions = {Vec3d(0, 0, -1)};
    camera.ups = {Vec3d(0, 1, 0)};
    camera.fov = 0.7;
    camera.width = 400, camera.height = 300;
    scene.settings.camera = camera;
    scene.settings.attributes = {"id"};
    scene.settings.tolerance = 1e-3;
    scene.settings.view.pixel_angle = 2.0 * std::tan(0.35) / 300.0;
    scene.settings.view.position = position;
    scene.settings.view.reference_depth = 1e-3 / (0.5 * scene.settings.view.pixel_angle); // half a pixel
}

struct Strand {
    std::vector<Vec3f> cvs;
    float radius;
};

// By where they begin.
std::map<std::array<float, 3>, Strand> strands_of(const World& world, size_t index = 0) {
    std::map<std::array<float, 3>, Strand> strands;
    const CurveGeometry& curves = world.curves[index];
    for (size_t c = 0; c < curves.curve_count; ++c) {
        Strand strand;
        for (uint32_t k = 0; k < curves.cvs_per_curve; ++k) strand.cvs.push_back(cv(curves, 0, c, k));
        strand.radius = curves.vertices[0][4 * (c * (curves.cvs_per_curve + 2) + 1) + 3];
        strands[{strand.cvs[0].x(), strand.cvs[0].y(), strand.cvs[0].z()}] = strand;
    }
    return strands;
}

double area_of(const World& world) { // length times radius
    double area = 0.0;
    for (const auto& [root, strand] : strands_of(world))
        for (size_t k = 1; k < strand.cvs.size(); ++k)
            area += double((strand.cvs[k] - strand.cvs[k - 1]).norm()) * double(strand.radius);
    return area;
}

} // namespace

TEST(LevelOfDetailOfStrands, AreSomeOfAllAndWider) {
    TestScene all(field + groom("grass", "ground", grass) + wind);
    TestScene few(field + groom("grass", "ground", grass + "lod = true\n") + wind);
    look_from(all, {0, 2, 40});
    look_from(few, {0, 2, 40});
    const World every = all.build(), some = few.build();
    const auto of_all = strands_of(every), of_some = strands_of(some);
    std::printf("%zu strands, %zu with a level of detail; area %.4f\n", of_all.size(), of_some.size(),
                area_of(some) / area_of(every));
    EXPECT_LT(of_some.size(), of_all.size() / 2);
    EXPECT_GT(of_some.size(), of_all.size() / 8);
    EXPECT_NEAR(area_of(some) / area_of(every), 1.0, 0.02);
    for (const auto& [root, strand] : of_some) {
        const auto same = of_all.find(root);
        ASSERT_NE(same, of_all.end());
        for (size_t k = 0; k < strand.cvs.size(); ++k) EXPECT_EQ(strand.cvs[k], same->second.cvs[k]);
        const double pixels =
            2.0 * double(strand.radius) /
            (all.settings.view.pixel_angle * double((strand.cvs[0] - Vec3f(0, 2, 40)).norm()));
        if (strand.radius > same->second.radius * 1.0001F) {
            EXPECT_LT(pixels, 0.5001);
        }
    }
}

TEST(LevelOfDetailOfStrands, BoundsHoldThem) {
    TestScene scene(field + groom("grass", "ground", grass + "lod = true\n"));
    look_from(scene, {0, 2, 40});
    const World world = scene.build();
    for (const auto& [root, strand] : strands_of(world))
        for (const Vec3f& p : strand.cvs)
            for (int axis = 0; axis < 3; ++axis) {
                Vec3f end = p;
                end[axis] += strand.radius;
                EXPECT_TRUE(world.bounds.contains(end));
            }
}

// The widths, in pixels, that a step of the camera changes: a fifth of the share's change at most, and a
// strand appears or vanishes with none.
TEST(LevelOfDetailOfStrands, NothingPopsAsTheCameraMoves) {
    TestScene scene(field + groom("grass", "ground", grass + "lod = true\n"));
    std::map<std::array<float, 3>, Strand> before;
    constexpr double step = 0.05;
    for (int i = 0; i < 6; ++i) {
        const Vec3d position(0.3 * step * i, 2, 40 - step * i);
        look_from(scene, position);
        const World world = scene.build();
        const auto now = strands_of(world);
        double most = 0.0;
        std::set<std::array<float, 3>> roots;
        for (const auto& [root, strand] : before) roots.insert(root);
        for (const auto& [root, strand] : now) roots.insert(root);
        size_t changes = 0;
        for (const auto& root : roots) {
            const auto a = before.find(root);
            const auto b = now.find(root);
            const double distance = (Vec3f(root.data()).cast<double>() - position).norm();
            const double from = a == before.end() ? 0.0 : double(a->second.radius),
                         to = b == now.end() ? 0.0 : double(b->second.radius);
            changes += a == before.end() || b == now.end();
            most = std::max(most, std::abs(to - from) * 2.0 / (distance * scene.settings.view.pixel_angle));
        }
        if (i > 0) {
            std::printf("%zu strands, %zu appear or vanish, widths change by at most %.4f pixels\n",
                        now.size(), changes, most);
            EXPECT_GT(changes, 0U);
            EXPECT_LT(most, 0.05);
        }
        before = now;
    }
}

TEST(LevelOfDetailOfStrands, EachInstanceHasItsOwn) {
    const std::string tufts =
        mesh("tuft", "plane",
             "size = [2, 2]\ndivisions = 4\ninstances = [{ transform = { translate = [0, 0, 36] } }, "
             "{ transform = { translate = [0, 0, -80] } }]\n");
    TestScene all(tufts + groom("grass", "tuft", "spacing = 0\ndensity = 500\ncvs = 4\n"));
    TestScene few(tufts + groom("grass", "tuft", "spacing = 0\ndensity = 500\ncvs = 4\nlod = true\n"));
    look_from(all, {0, 1, 40});
    look_from(few, {0, 1, 40});
    const World every = all.build(), some = few.build();
    const auto of_all = strands_of(every);
    size_t near = 0, middle = 0, far = 0;
    for (const auto& [root, strand] : strands_of(some)) {
        EXPECT_TRUE(of_all.contains(root));
        ++(root[2] > 20 ? near : root[2] < -40 ? far : middle);
    }
    std::printf("%zu near, %zu in the middle, %zu far\n", near, middle, far);
    EXPECT_NEAR(double(near), 2000.0, 40.0);
    EXPECT_LT(middle, near);
    EXPECT_LT(far, middle * 3 / 4);
    EXPECT_GT(far, 100U);
    EXPECT_EQ(some.curves[0].curve_count, near + middle + far);
}

// Strands are widened as they are rendered; they collide as all do.
TEST(LevelOfDetailOfStrands, CollideWithTheirOwnWidth) {
    const std::string floor =
        field + mesh("sheet", "plane", "size = [60, 60]\ntransform = { translate = [0, 0.3, 0] }\n");
    const std::string collides =
        "\n[wind]\nspeed = 8\nglobal_rotate = 1\ncollision = { solver = \"exact\" }\n";
    TestScene all(floor + groom("grass", "ground", grass) + collides);
    TestScene few(floor + groom("grass", "ground", grass + "lod = true\n") + collides);
    look_from(all, {0, 2, 80});
    look_from(few, {0, 2, 80});
    const auto of_all = strands_of(all.build()), of_some = strands_of(few.build());
    EXPECT_LT(of_some.size(), of_all.size() / 3);
    for (const auto& [root, strand] : of_some) {
        const auto same = of_all.find(root);
        ASSERT_NE(same, of_all.end());
        for (size_t k = 0; k < strand.cvs.size(); ++k) EXPECT_EQ(strand.cvs[k], same->second.cvs[k]);
    }
}

TEST(LevelOfDetailOfStrands, APreviewsShareIsOfThem) {
    const std::string text = field + groom("grass", "ground", grass + "lod = true\n");
    TestScene whole(text), part(text);
    look_from(whole, {0, 2, 40});
    look_from(part, {0, 2, 40});
    part.settings.share = 0.25;
    const World every = whole.build(), some = part.build();
    EXPECT_EQ(some.curves[0].all_curves, every.curves[0].curve_count);
    EXPECT_NEAR(double(some.curves[0].curve_count) / double(every.curves[0].curve_count), 0.25, 0.02);
}

TEST(LevelOfDetailOfStrands, OthersReadAllOfThem) {
    const std::string guides = groom("guides", "ground", grass + "lod = true\n");
    const std::string children = "\n[[procedural]]\ntype = \"groom\"\nname = \"children\"\non = "
                                 "\"ground\"\nguides.curves = \"guides\"\n"
                                 "width = 0.01\ncount = 100\n";
    TestScene scene(field + guides + children), plain(field + groom("guides", "ground", grass) + children);
    look_from(scene, {0, 2, 40});
    look_from(plain, {0, 2, 40});
    EXPECT_EQ(scene.build().curves[0].curve_count, plain.build().curves[0].curve_count);
}

TEST(LevelOfDetailOfStrands, WithoutACameraAllAreMade) {
    TestScene scene(field + groom("grass", "ground", grass + "lod = true\n")),
        plain(field + groom("grass", "ground", grass));
    EXPECT_EQ(strands_of(scene.build()).size(), strands_of(plain.build()).size());
}

// Frames of a moving camera: what is made does not depend on the frames before.
TEST(LevelOfDetailOfStrands, AreTheSameAfterOtherFrames) {
    const std::string text = field + groom("grass", "ground", grass + "lod = true\ncanopy = true\n") + wind +
                             "jiggle = { frequency = 2, damping = 0.4 }\n";
    TestScene moved(text), fresh(text);
    look_from(moved, {0, 2, 60});
    moved.build();
    moved.settings.frame = 2.0;
    look_from(moved, {0, 2, 40});
    fresh.settings.frame = 2.0;
    look_from(fresh, {0, 2, 40});
    const World a = moved.build(), b = fresh.build();
    ASSERT_EQ(a.curves[0].curve_count, b.curves[0].curve_count);
    const auto layout = a.curves[0].layout();
    for (size_t t = 0; t < a.curves[0].vertices.size(); ++t)
        for (size_t i = 0; i < 4 * layout.vertex_count(); ++i)
            ASSERT_EQ(a.curves[0].vertices[t][i], b.curves[0].vertices[t][i]) << t << " " << i;
}

} // namespace marram::testing
