// SPDX-License-Identifier: Apache-2.0
// The two-phase build: moving objects are at the right place at every motion sample, curves move with their
// mesh, and both scenes share colliders with IDs that depend only on the description.
#include "build_scene.h"

#include <gtest/gtest.h>

#include <cstring>

namespace marram::testing {
namespace {

const std::string translating = "transform = { keys = [{ frame = 1, translate = [0, 0, 0] }, "
                                "{ frame = 3, translate = [4, -2, 8] }] }\n";
const std::string rotating =
    "transform = { keys = [{ frame = 1, rotate = [0, 0, 0] }, { frame = 3, rotate = [0, 120, 0] }] }\n";

// Where the transforms above move a point of object space at a frame between 1 and 3.
Vec3d translated(const Vec3d& p, double frame) { return p + (frame - 1.0) * Vec3d(2, -1, 4); }
Vec3d rotated(const Vec3d& p, double frame) {
    const double angle = (frame - 1.0) * 60.0 * degree, c = std::cos(angle), s = std::sin(angle);
    return {c * p.x() + s * p.z(), p.y(), c * p.z() - s * p.x()};
}
using Motion = Vec3d (*)(const Vec3d&, double);

void open_shutter(TestScene& scene, uint32_t keys) {
    scene.settings.frame = 2.0;
    scene.settings.shutter_open = -0.25;
    scene.settings.shutter_close = 0.5;
    scene.settings.motion_keys = keys;
}

TEST(MotionTimes, AreEquallySpacedWithExactEnds) {
    EXPECT_EQ(motion_times(7.1, 7.1, 2), std::vector<double>{7.1});
    for (const uint32_t keys : {2u, 3u, 7u, 64u}) {
        const std::vector<double> times = motion_times(7.1 - 0.3, 7.1 + 0.1, keys);
        ASSERT_EQ(times.size(), keys);
        EXPECT_EQ(times.front(), 7.1 - 0.3);
        EXPECT_EQ(times.back(), 7.1 + 0.1);
        for (size_t i = 1; i < keys; ++i) EXPECT_NEAR(times[i] - times[i - 1], 0.4 / (keys - 1), 1e-14);
    }
}

class MotionKeys : public ::testing::TestWithParam<uint32_t> {};

TEST_P(MotionKeys, MeshesAreExactAtShutterTimes) {
    const auto check = [&](const std::string& transform, Motion motion) {
        TestScene scene(mesh("ball", "sphere", "divisions = 6\n" + transform));
        open_shutter(scene, GetParam());
        const World world = scene.build();
        const MeshGeometry& ball = world.meshes[0];
        ASSERT_EQ(ball.positions.size(), GetParam());
        ASSERT_EQ(ball.normals.size(), GetParam());
        const Mesh& source = scene.geometry.meshes[0].mesh;
        for (size_t t = 0; t < world.times.size(); ++t)
            for (size_t i = 0; i < source.positions.size(); ++i) {
                const Vec3d exact = motion(source.positions[i].cast<double>(), world.times[t]);
                const Vec3d turned = motion(source.normals[i].cast<double>(), world.times[t]) -
                                     motion(Vec3d::Zero(), world.times[t]);
                EXPECT_LT((ball.positions[t][i].cast<double>() - exact).norm(), 1e-6) << "key " << t;
                EXPECT_LT((ball.normals[t][i].cast<double>() - turned).norm(), 1e-6) << "key " << t;
            }
    };
    check(translating, translated);
    check(rotating, rotated);
}

// A plane's uv gives the place of a root: u runs along x, v against z.
TEST_P(MotionKeys, CurvesRideOnMeshes) {
    const auto check = [&](const std::string& transform, Motion motion, const std::string& wind) {
        TestScene scene(mesh("ground", "plane", "size = [4, 4]\n" + transform) +
                        groom("hair", "ground", wind));
        open_shutter(scene, GetParam());
        scene.settings.attributes = {"root_uv", "no_such_attribute"};
        const World world = scene.build();
        const CurveGeometry& curves = world.curves[0];
        ASSERT_EQ(curves.vertices.size(), GetParam());
        ASSERT_EQ(curves.attributes.size(), 1u);
        const AttributeValues& uv = *attribute(curves, "root_uv");
        for (size_t c = 0; c < curves.curve_count; ++c) {
            const Vec3d root(4.0 * (double(uv.values[2 * c]) - 0.5), 0.0,
                             4.0 * (0.5 - double(uv.values[2 * c + 1])));
            for (size_t t = 0; t < world.times.size(); ++t)
                EXPECT_LT((cv(curves, t, c, 0).cast<double>() - motion(root, world.times[t])).norm(), 3e-6);
        }
    };
    const std::string wind = "wind = { speed = 8, noise = { amplitude = 2 } }\n";
    check(translating, translated, "");
    check(translating, translated, wind);
    check(rotating, rotated, "");
    check(rotating, rotated, wind);
}
INSTANTIATE_TEST_SUITE_P(All, MotionKeys, ::testing::Values(2u, 3u, 7u, 64u));

TEST(Motion, IsLeftOutWhereNothingMoves) {
    TestScene scene(mesh("still", "plane") + mesh("moving", "plane", translating) + groom("hair", "still"));
    open_shutter(scene, 5);
    const World world = scene.build();
    EXPECT_EQ(world.meshes[0].positions.size(), 1u);
    EXPECT_EQ(world.meshes[1].positions.size(), 5u);
    EXPECT_EQ(world.curves[0].vertices.size(), 1u);
    scene.settings.frame = 20.0; // after the last key
    EXPECT_EQ(scene.build().meshes[1].positions.size(), 1u);
}

// The tolerance chooses: for meshes from their transform, for strands by testing some of them.
TEST(Motion, KeysAreChosenByTheTolerance) {
    const std::string windy = "wind = { speed = 6, noise = { amplitude = 1, frequency = 2 } }\n";
    const auto keys = [&](const std::string& items, double tolerance, size_t* samples = nullptr) {
        TestScene scene(items);
        open_shutter(scene, 0);
        scene.settings.tolerance = tolerance;
        const World world = scene.build();
        EXPECT_EQ(scene.stats.motion_keys, world.times.size());
        size_t most = 2;
        for (const MeshGeometry& mesh : world.meshes) most = std::max(most, mesh.positions.size());
        for (const CurveGeometry& curves : world.curves) most = std::max(most, curves.vertices.size());
        EXPECT_EQ(world.times.size(), most);
        if (samples) *samples = world.curves[0].vertices.size();
        return world.times.size();
    };
    const std::string ground = mesh("ground", "plane", "size = [4, 4]\n");
    const std::string turning = mesh("wheel", "box", rotating), gliding = mesh("wheel", "box", translating);
    size_t samples = 0;
    EXPECT_EQ(keys(ground + groom("hair", "ground"), 1e-6, &samples), 2u);
    EXPECT_EQ(samples, 1u) << "nothing blows";
    EXPECT_EQ(keys(ground + groom("hair", "ground", windy), 10.0, &samples), 2u);
    EXPECT_EQ(samples, 2u);
    const size_t blown = keys(ground + groom("hair", "ground", windy), 1e-4, &samples);
    EXPECT_GT(blown, 3u);
    EXPECT_LT(blown, 40u);
    EXPECT_EQ(samples, blown);
    EXPECT_GT(keys(ground + groom("hair", "ground", windy), 1e-6), blown);
    EXPECT_EQ(keys(gliding + ground + groom("hair", "ground"), 1e-4), 2u);
    const size_t turned = keys(turning + ground + groom("hair", "ground"), 1e-4);
    EXPECT_GT(turned, 5u);
    EXPECT_EQ(keys(turning + ground + groom("hair", "ground", windy), 1e-4, &samples),
              std::max(turned, blown));
    EXPECT_EQ(samples, blown) << "as many as it needs itself, whatever turns beside it";
    EXPECT_EQ(keys(gliding + ground + groom("hair", "ground", windy), 1e-4), blown);

    // Many nearly still strands do not hide a few blown ones.
    const std::string calm =
        "count = 5000\nwind = { speed = 0.01, noise = { amplitude = 3, frequency = 4 } }\n";
    EXPECT_EQ(keys(ground + groom("hair", "ground", windy) + groom("grass", "ground", calm), 1e-4), blown);

    // The same bits as with that number of keys set by hand: testing strands has no side effects.
    TestScene chosen(gliding + ground + groom("hair", "ground", windy)),
        asked(gliding + ground + groom("hair", "ground", windy));
    open_shutter(chosen, 0);
    chosen.settings.tolerance = 1e-4;
    open_shutter(asked, uint32_t(blown));
    asked.settings.tolerance = 1e-4;
    const World a = chosen.build(), b = asked.build();
    EXPECT_EQ(a.times, b.times);
    EXPECT_EQ(a.meshes[0].positions.size(), 2u);
    EXPECT_EQ(a.meshes[0].positions.front(), b.meshes[0].positions.front());
    EXPECT_EQ(a.meshes[0].positions.back(), b.meshes[0].positions.back());
    EXPECT_EQ(chosen.stats.triangles, asked.stats.triangles);
    for (size_t t = 0; t < b.times.size(); ++t)
        EXPECT_EQ(std::memcmp(a.curves[0].vertices[t], b.curves[0].vertices[t],
                              b.curves[0].curve_count * (b.curves[0].cvs_per_curve + 2) * 16),
                  0);
}

const std::string populated = mesh("b", "box") + groom("hair 2", "a") + mesh("a", "plane") +
                              groom("hair 1", "b") + "[[procedural]]\ntype = \"pyramid\"\nname = \"tomb\"\n" +
                              mesh("c", "sphere", "divisions = 5\n");

TEST(WorldScenes, ShareTheColliders) {
    TestScene scene(populated);
    const World world = scene.build();
    ASSERT_EQ(world.meshes.size(), 4u);
    for (unsigned i = 0; i < 4; ++i) {
        ASSERT_NE(rtcGetGeometry(world.colliders.get(), i), nullptr);
        EXPECT_EQ(rtcGetGeometry(world.colliders.get(), i), rtcGetGeometry(world.scene.get(), i));
    }
}

// Traces a ray straight down from a point. Returns the geometry that it hits.
unsigned first_below(RTCScene scene, const Vec3f& from) {
    RTCRayHit ray{};
    ray.ray = {from.x(), from.y(), from.z(), 0.0F, 0.0F, -1.0F, 0.0F, 0.0F, 100.0F, ~0U, 0, 0};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(scene, &ray, 0);
    return ray.hit.geomID;
}

TEST(WorldScenes, NumberGeometriesInTheDescriptionsOrder) {
    TestScene scene(populated);
    const World world = scene.build();
    std::vector<std::string> names;
    for (const MeshGeometry& mesh : world.meshes) names.push_back(mesh.name);
    for (const CurveGeometry& curves : world.curves) names.push_back(curves.name);
    EXPECT_EQ(names, (std::vector<std::string>{"b", "a", "c", "tomb", "hair 2", "hair 1"}));
    // Over this point the box ends at 0.5 m, the pyramid at 0.55, the sphere at 0.84.
    EXPECT_EQ(first_below(world.colliders.get(), {0.45F, 0.52F, 0.3F}), 0u);
    EXPECT_EQ(first_below(world.colliders.get(), {4.7F, 2.0F, 4.6F}), 1u);
    EXPECT_EQ(first_below(world.colliders.get(), {0.45F, 2.0F, 0.3F}), 2u);
    EXPECT_EQ(first_below(world.colliders.get(), {0.45F, 0.7F, 0.3F}), 3u);
    for (unsigned i = 0; i < 2; ++i) { // from above the middle of a strand
        const CurveGeometry& curves = world.curves[i];
        size_t hits = 0;
        for (size_t c = 0; c < curves.curve_count; ++c) {
            const Vec3f p = cv(curves, 0, c, 4);
            hits += first_below(world.scene.get(), p + Vec3f(0, 0.02F, 0)) == 4 + i;
        }
        EXPECT_GT(hits, curves.curve_count / 3) << curves.name;
    }
}

TEST(WorldScenes, HoldEverythingWithinTheirBounds) {
    TestScene scene(populated + "\n[wind]\nspeed = 9\nnoise = { amplitude = 3 }\n");
    open_shutter(scene, 4);
    const World world = scene.build();
    Box3f promised;
    for (const Box3f& box : scene.stats.patch_bounds) promised.extend(box);
    for (const CurveGeometry& curves : world.curves)
        for (size_t t = 0; t < curves.vertices.size(); ++t)
            for (size_t c = 0; c < curves.curve_count; ++c)
                for (uint32_t k = 0; k < curves.cvs_per_curve; ++k)
                    EXPECT_TRUE(promised.contains(cv(curves, t, c, k)));
    for (const MeshGeometry& mesh : world.meshes)
        for (const Vec3f& p : mesh.positions[0]) EXPECT_LT(world.bounds.exteriorDistance(p), 1e-4F);
}

TEST(WorldScenes, AreTheSameEveryTime) {
    TestScene scene(populated + "\n[wind]\nspeed = 9\n");
    open_shutter(scene, 3);
    const World first = scene.build();
    scene.settings.frame = 40.0;
    scene.build();
    scene.settings.frame = 2.0;
    const World again = scene.build();
    for (size_t i = 0; i < first.curves.size(); ++i) {
        const CurveGeometry &a = first.curves[i], &b = again.curves[i];
        ASSERT_EQ(a.vertices.size(), b.vertices.size());
        const size_t bytes = a.curve_count * (a.cvs_per_curve + 2) * 16;
        for (size_t t = 0; t < a.vertices.size(); ++t)
            EXPECT_EQ(std::memcmp(a.vertices[t], b.vertices[t], bytes), 0);
    }
}

double signed_volume(const MeshGeometry& mesh, size_t time) {
    double six = 0.0;
    for (const auto& t : mesh.triangles) {
        const auto p = [&](size_t i) -> Vec3d { return mesh.positions[time][t[i]].cast<double>(); };
        six += p(0).dot(p(1).cross(p(2)));
    }
    return six / 6.0;
}

TEST(MirroredTransforms, KeepTheOutsideOut) {
    for (const char* scale :
         {"[-1, 1, 1]", "[1, -2, 1]", "[1, 1, -0.5]", "[-1, -1, -1]", "[-1, -1, 1]", "-2"}) {
        const std::string keys = std::string("transform = { keys = [{ frame = 1, scale = ") + scale +
                                 " }, { frame = 3, rotate = [90, 0, 30], scale = " + scale + " }] }\n";
        TestScene scene(mesh("ball", "sphere", "divisions = 8\n" + keys) + mesh("box", "box", keys));
        open_shutter(scene, 3);
        const World world = scene.build();
        for (size_t t = 0; t < 3; ++t) {
            EXPECT_GT(signed_volume(world.meshes[0], t), 0.0) << scale;
            EXPECT_GT(signed_volume(world.meshes[1], t), 0.0) << scale;
            size_t inward = 0;
            for (size_t i = 0; i < world.meshes[0].positions[t].size(); ++i)
                inward += !(world.meshes[0].positions[t][i].dot(world.meshes[0].normals[t][i]) > 0.0F);
            EXPECT_EQ(inward, 0u) << "normals at key " << t << ", scale " << scale;
        }
    }
}

// Strands on a mirrored ball grow outwards.
TEST(MirroredTransforms, GrowHairOutwards) {
    TestScene scene(mesh("ball", "sphere", "divisions = 16\ntransform = { scale = [-1, 1, 1] }\n") +
                    groom("hair", "ball", "lean = 0\narc = 0\n"));
    const World world = scene.build();
    const CurveGeometry& hair = world.curves[0];
    size_t inward = 0;
    for (size_t c = 0; c < hair.curve_count; ++c)
        inward += !(cv(hair, 0, c, hair.cvs_per_curve - 1).norm() > cv(hair, 0, c, 0).norm() + 0.05F);
    EXPECT_EQ(inward, 0u);
}

TEST(Baking, MakesCurvesWithoutAttachingThem) {
    TestScene scene(populated);
    scene.settings.trace_curves = false;
    const World world = scene.build();
    EXPECT_EQ(world.curves.size(), 2u);
    for (const CurveGeometry& curves : world.curves) // rays near a strand hit a mesh or nothing
        for (size_t c = 0; c < curves.curve_count; ++c) {
            const unsigned hit = first_below(world.scene.get(), cv(curves, 0, c, 4) + Vec3f(0, 0.02F, 0));
            EXPECT_TRUE(hit < 4 || hit == RTC_INVALID_GEOMETRY_ID) << hit;
        }
    EXPECT_EQ(scene.stats.curves, 400u);
    EXPECT_EQ(scene.stats.cvs, 3200u);
    EXPECT_EQ(scene.stats.segments, 2800u);
}

TEST(Growth, OnAMeshThatIsNotThereIsRefused) {
    TestScene scene(mesh("a", "plane") + groom("hair", "hair 2") + groom("hair 2", "a"));
    const std::string text = scene.build_errors();
    EXPECT_NE(text.find("'hair 2' makes no mesh"), std::string::npos) << text;
    EXPECT_NE(text.find(".toml:"), std::string::npos) << text;
}

} // namespace
} // namespace marram::testing
