// SPDX-License-Identifier: Apache-2.0
// Instances of a mesh and of the strands on it: the same strands at another place, in the wind of that place.
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace marram::testing {
namespace {

// The transform from the mesh to its instance: rotated by 90 degrees about y, scaled by 2, moved.
const std::string turned_twice_as_large =
    "{ rotate = [0, 90, 0], scale = [2, 2, 2], translate = [5, 1, -3] }";

Eigen::Affine3d turned_by(double degrees, double scale, const Vec3d& translation) {
    Eigen::Affine3d placed = Eigen::Affine3d::Identity();
    placed.translate(translation);
    placed.rotate(Eigen::AngleAxisd(degrees * pi / 180.0, Vec3d::UnitY()));
    placed.scale(scale);
    return placed;
}

std::string furred(const std::string& instances, const std::string& more = "", const std::string& wind = "") {
    return "\n[wind]\n" + wind + mesh("ball", "sphere", instances) +
           groom("fur", "ball",
                 "count = 300\nspacing = 0\ncvs = 6\nlean = 20\narc = 40\ncurl = { radius = 0.01, turns = 2 "
                 "}\n" +
                     more);
}

std::string instances(const std::vector<std::string>& transforms) {
    std::string text = "instances = [";
    for (const std::string& transform : transforms) text += "{ transform = " + transform + " }, ";
    return text + "]\n";
}

std::string moved_by(double x, double y, double z) {
    return "{ translate = [" + std::to_string(x) + ", " + std::to_string(y) + ", " + std::to_string(z) +
           "] }";
}

// The greatest distance, over all times, between the CVs of `count` curves from `second` on and those from
// `first` on moved by `placed`. Radii are compared too.
double farthest(const CurveGeometry& a, size_t first, const CurveGeometry& b, size_t second, size_t count,
                const Eigen::Affine3d& placed) {
    const double scale = std::cbrt(std::abs(placed.linear().determinant()));
    double most = 0.0;
    for (size_t t = 0; t < b.vertices.size(); ++t)
        for (size_t c = 0; c < count; ++c)
            for (uint32_t k = 0; k < a.cvs_per_curve; ++k) {
                const size_t time = std::min(t, a.vertices.size() - 1);
                const Vec3d expected = placed * cv(a, time, first + c, k).cast<double>();
                most = std::max(most, (cv(b, t, second + c, k).cast<double>() - expected).norm());
                const auto radius = [&](const CurveGeometry& curves, size_t curve) {
                    return double(curves.vertices[t < curves.vertices.size() ? t : 0]
                                                 [4 * (curve * (curves.cvs_per_curve + 2) + k + 1) + 3]);
                };
                most = std::max(most, std::abs(radius(b, second + c) - scale * radius(a, first + c)));
            }
    return most;
}

TEST(Instances, AreTheSameStrandsElsewhere) {
    for (const char* more : {"", "shape = \"oriented-ribbon\"\n",
                             "frizz = { amplitude = 0.01 }\nclump = { size = 0.1, amount = 0.5 }\n"}) {
        TestScene scene(furred(instances({turned_twice_as_large, moved_by(0, 0, 9)}), more, "speed = 0\n"));
        scene.settings.attributes = {"root_normal", "id"};
        const World world = scene.build();
        ASSERT_EQ(world.meshes.size(), 3u);
        EXPECT_EQ(world.meshes[1].name, "ball[0]");
        const CurveGeometry& fur = world.curves.at(0);
        ASSERT_EQ(fur.curve_count, 900u);
        EXPECT_LT(farthest(fur, 0, fur, 300, 300, turned_by(90, 2, {5, 1, -3})), 2e-6);
        EXPECT_LT(farthest(fur, 0, fur, 600, 300, turned_by(0, 1, {0, 0, 9})), 2e-6);
        const std::vector<float>&id = attribute(fur, "id")->values,
              &normal = attribute(fur, "root_normal")->values;
        for (size_t c = 0; c < 300; ++c) {
            EXPECT_EQ(id[c], id[300 + c]);
            const Vec3d n = Eigen::Map<const Vec3f>(normal.data() + 3 * c).cast<double>(),
                        there = Eigen::Map<const Vec3f>(normal.data() + 3 * (300 + c)).cast<double>();
            EXPECT_LT((turned_by(90, 1, {0, 0, 0}) * n - there).norm(), 1e-6);
        }
        EXPECT_EQ(scene.stats.report("instances.count"), 2.0);
        EXPECT_GT(scene.stats.report("instances.shared_bytes"), 300.0 * 8);
        for (size_t v = 0; v < world.meshes[0].positions[0].size(); ++v) // the mesh itself
            ASSERT_LT((turned_by(90, 2, {5, 1, -3}) * world.meshes[0].positions[0][v].cast<double>() -
                       world.meshes[1].positions[0][v].cast<double>())
                          .norm(),
                      2e-6);
    }
}

// A separate mesh at that place with the same roots is blown, sheltered, jiggled and collided like the
// instance.
TEST(Instances, StandInTheWindOfTheirPlace) {
    const std::string wind =
        "speed = 8\ncalm = 1\nnoise = { frequency = 1 }\nshielding = { shield = 1, spread = 10 }\ncollision "
        "= { solver = \"exact\", offset_scale = 0.2 }\n"
        "jiggle = { frequency = 3, step = 0.5 }\ngusts = { num_gusts = 20, radius_range = [1, 2] }\n";
    const std::string wall = mesh("wall", "box", "size = [0.5, 4, 4]\ntransform = { translate = [3, 0, 0] }");
    const auto with_instances = "\n[wind]\n" + wind + wall +
                                mesh("ball", "sphere", instances({moved_by(5, 0, 0), moved_by(0, 0, 30)})) +
                                groom("fur", "ball", "count = 300\nspacing = 0\ncvs = 6\nlean = 20\n");
    TestScene scene(with_instances);
    scene.settings.frame = 12;
    scene.settings.shutter_close = 0.5;
    const World world = scene.build();
    const CurveGeometry& fur = world.curves.at(0);
    ASSERT_EQ(fur.curve_count, 900u);
    // The separate meshes neither touch nor shelter each other; the gusts' box is that of the scene's meshes.
    const double own = farthest(fur, 0, fur, 300, 300, turned_by(0, 1, {5, 0, 0}));
    EXPECT_GT(own, 0.02) << "it is the wind of another place";
    TestScene alone("\n[wind]\n" + wind + wall + mesh("ball", "sphere") +
                    mesh("near", "sphere", "transform = " + moved_by(5, 0, 0)) +
                    mesh("far", "sphere", "transform = " + moved_by(0, 0, 30)) +
                    groom("fur", "near", "count = 300\nspacing = 0\ncvs = 6\nlean = 20\n") +
                    groom("more", "far", "count = 300\nspacing = 0\ncvs = 6\nlean = 20\n"));
    alone.settings.frame = 12;
    alone.settings.shutter_close = 0.5;
    const World other = alone.build();
    ASSERT_EQ(other.curves[0].vertices.size(), fur.vertices.size());
    EXPECT_LT(farthest(other.curves[0], 0, fur, 300, 300, turned_by(0, 1, {0, 0, 0})), 2e-4);
    EXPECT_LT(farthest(other.curves[1], 0, fur, 600, 300, turned_by(0, 1, {0, 0, 0})), 2e-4);
    EXPECT_EQ(scene.stats.report("collision.unresolved"), 0.0);
}

// An instance that moves while its mesh rests, within the shutter and before it.
TEST(Instances, MoveByThemselves) {
    const std::string rolling =
        "{ keys = [{ frame = 1, translate = [3, 0, 0] }, { frame = 11, translate = [13, 0, 0], "
        "rotate = [0, 180, 0] }] }";
    TestScene scene(furred(instances({rolling}), "", "speed = 0\n"));
    scene.settings.frame = 6;
    scene.settings.shutter_close = 1.0;
    scene.settings.motion_keys = 3;
    const World world = scene.build();
    const CurveGeometry& fur = world.curves.at(0);
    ASSERT_EQ(fur.vertices.size(), 3u);
    for (size_t t = 0; t < 3; ++t)
        for (size_t c = 0; c < 300; ++c)
            for (uint32_t k = 0; k < 6; ++k) {
                const double frame = 6.0 + 0.5 * double(t);
                const Eigen::Affine3d placed = turned_by(18.0 * (frame - 1.0), 1, {3 + frame - 1.0, 0, 0});
                ASSERT_EQ(cv(fur, t, c, k), cv(fur, 0, c, k)) << "the mesh rests";
                ASSERT_LT(
                    (placed * cv(fur, 0, c, k).cast<double>() - cv(fur, t, 300 + c, k).cast<double>()).norm(),
                    4e-6);
            }
    // Moving instances jiggle.
    TestScene swinging(
        furred(instances({rolling}), "", "speed = 0\njiggle = { frequency = 2, damping = 0.2 }\n"));
    swinging.settings.frame = 6;
    const World late = swinging.build();
    EXPECT_GT(farthest(late.curves[0], 0, late.curves[0], 300, 300, turned_by(90, 1, {8, 0, 0})), 1e-3);
    for (size_t c = 0; c < 300; ++c)
        ASSERT_LT((cv(late.curves[0], 0, c, 5) - cv(fur, 0, c, 5)).norm(), 1e-5F) << "what rests does not";
}

TEST(Instances, FollowGuides) {
    const std::string guides = "\n[[curves]]\ntype = \"points\"\nname = \"guide\"\npoints = [[0, 1, 0], "
                               "[0.05, 1.1, 0], [0.2, 1.2, 0]]\n";
    for (const char* wind_on_guides : {"false", "true"}) {
        const std::string text =
            "\n[wind]\nspeed = 6\nnoise = { amplitude = 0 }\n" + guides +
            mesh("ball", "sphere", instances({turned_twice_as_large, moved_by(0, 0, 40)})) +
            "\n[[procedural]]\ntype = \"groom\"\nname = \"fur\"\non = \"ball\"\nwidth = 0.01\n" +
            (std::string("count = 100\nspacing = 0\ncvs = 6\nguides = { curves = \"guide\", wind = ") +
             (std::string(wind_on_guides) == "true" ? "\"guides\"" : "\"strands\"") + " }\n");
        TestScene blown(text);
        const World world = blown.build();
        const CurveGeometry& fur = world.curves.at(0);
        ASSERT_EQ(fur.curve_count, 300u);
        // The wind is uniform: moved instances bend like the original, rotated ones do not.
        EXPECT_LT(farthest(fur, 0, fur, 200, 100, turned_by(0, 1, {0, 0, 40})), 1e-5);
        EXPECT_GT(farthest(fur, 0, fur, 100, 100, turned_by(90, 2, {5, 1, -3})), 0.01);
        TestScene still(text);
        still.settings.stage = MARRAM_REST;
        const World rest = still.build();
        EXPECT_LT(farthest(rest.curves[0], 0, rest.curves[0], 100, 100, turned_by(90, 2, {5, 1, -3})), 4e-6);
        EXPECT_GT(farthest(rest.curves[0], 0, fur, 0, 100, turned_by(0, 1, {0, 0, 0})), 0.01)
            << "it is blown";
    }
}

// The patches' bounds contain the strands of every instance; an instance is a collider like its mesh.
TEST(Instances, AreBoundedAndCollide) {
    TestScene scene(furred(instances({turned_twice_as_large, moved_by(2.3, 0, 0)}), "",
                           "speed = 12\ncollision = { solver = \"exact\", offset_scale = 0.2 }\n"));
    const World world = scene.build();
    const CurveGeometry& fur = world.curves.at(0);
    Box3f all;
    for (const Box3f& box : scene.stats.patch_bounds) all.extend(box);
    for (size_t c = 0; c < fur.curve_count; ++c)
        for (uint32_t k = 0; k < 6; ++k) {
            ASSERT_TRUE(all.contains(cv(fur, 0, c, k)));
            if (k == 0) continue;
            for (const auto& [centre, radius] :
                 {std::pair(Vec3f(0, 0, 0), 1.0F), {Vec3f(2.3F, 0, 0), 1.0F}, {Vec3f(5, 1, -3), 2.0F}}) {
                ASSERT_GT((cv(fur, 0, c, k) - centre).norm(), 0.98F * radius) << c << " " << k;
            }
        }
}

// The tolerance chooses for the largest instance, and treats a moving instance like a moving mesh.
TEST(Instances, CountWhereTheToleranceChooses) {
    const auto chosen = [](const std::string& transform, const std::string& what) {
        TestScene scene("\n[wind]\nspeed = 1\nreference_segments = 7\njiggle = { frequency = 1 }\n"
                        "noise = { amplitude = 1, frequency = 1, octaves = 4 }\n" +
                        mesh("ball", "sphere", transform.empty() ? "" : instances({transform})) +
                        groom("fur", "ball", "count = 300\ncvs = 0\n"));
        scene.settings.frame = 12;
        scene.settings.tolerance = 0.01;
        scene.build();
        for (const auto& [path, value] : scene.geometry.procedurals[0]->report())
            if (path == what) return value;
        return 0.0;
    };
    EXPECT_GT(chosen("{ scale = [20, 20, 20] }", "chosen.cvs"), 1.5 * chosen("", "chosen.cvs"));
    EXPECT_EQ(chosen(moved_by(9, 0, 0), "chosen.cvs"), chosen("", "chosen.cvs"));
    EXPECT_LE(chosen("{ keys = [{ frame = 1, translate = [5, 0, 0] }, { frame = 8, translate = [7, 0, 0] }, "
                     "{ frame = 9, translate = [5, 0, 0] }] }",
                     "chosen.jiggle_step"),
              0.5);
}

// A procedural that makes a mesh from a mesh ignores its instances.
TEST(Instances, AreNothingToARock) {
    const auto rate = [](const std::string& more) {
        TestScene scene(
            mesh("stone", "sphere", more) +
            "\n[[procedural]]\ntype = \"rock\"\nname = \"rock\"\nmesh = \"stone\"\npaths = 20000\n");
        const World world = scene.build();
        for (const MeshGeometry& mesh : world.meshes)
            if (const AttributeValues* found = find_attribute(mesh.attributes, "wear_rate"))
                return found->values;
        return std::vector<float>();
    };
    const std::vector<float> alone = rate("");
    ASSERT_FALSE(alone.empty());
    EXPECT_EQ(rate(instances({moved_by(-2.2, 0, 0)})), alone);
}

TEST(Instances, SayWhatIsWrong) {
    EXPECT_THROW(TestScene(furred(instances({"{ keys = [{ frame = 1, scale = [1, 1, 1] }, "
                                             "{ frame = 3, scale = [-1, -1, 1] }] }"}))),
                 InputError);
    EXPECT_THROW(TestScene(furred(instances({moved_by(1, 0, 0)})) + mesh("ball[0]", "box")), InputError);
    EXPECT_THROW(TestScene(furred(instances({"{ scale = [1, 2, 1] }"}))), InputError);
    EXPECT_THROW(TestScene(furred(instances({"{ scale = [0, 0, 0] }"}))), InputError);
    EXPECT_NO_THROW(TestScene(furred(instances({"{ scale = [-1, 1, 1] }"}))));
    EXPECT_NO_THROW(TestScene(furred("instances = []\n")));
}

} // namespace
} // namespace marram::testing
