// SPDX-License-Identifier: Apache-2.0
// Grooms among other meshes and in winds that do nothing: what is left out, and what the user is told.
#include "core/geometry/mesh_sides.h"
#include "procedural/wind/strands.h"
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace marram::testing {
namespace {

// A lawn with a house on it, whose floor lies on the ground. 400 strands, 1/16 of them under the house.
std::string lawn_with_house(const std::string& house, const std::string& grass = "",
                            const std::string& wind = "collision = { solver = \"exact\" }\n",
                            const std::string& ground = "") {
    return "\n[wind]\n" + wind + mesh("ground", "plane", "size = [4, 4]\n" + ground) +
           mesh("house", "box", "size = [1, 1, 1]\n" + house) +
           groom("grass", "ground", "density = 25\ncvs = 4\n" + grass);
}
const std::string stands_on_it = "transform = { translate = [0, 0.5, 0] }\n";

uint64_t strands_of(TestScene& scene, bool under_the_house) {
    const World world = scene.build();
    const CurveGeometry& grass = world.curves.at(0);
    uint64_t count = 0;
    for (uint64_t c = 0; c < grass.curve_count; ++c) {
        const Vec3f root = cv(grass, 0, c, 0);
        count += !under_the_house || (std::abs(root.x()) < 0.5F && std::abs(root.z()) < 0.5F);
    }
    return count;
}
uint64_t strands_of(const std::string& text, bool under_the_house = false) {
    TestScene scene(text);
    return strands_of(scene, under_the_house);
}

bool warns(const TestScene& scene, const std::string& text) {
    return std::ranges::any_of(scene.stats.warnings, [&](const Problem& warning) {
        return to_string(warning).find(text) != std::string::npos;
    });
}

} // namespace

TEST(CoveredRoots, AreLeftOutAndNamed) {
    const uint64_t all = strands_of(lawn_with_house(stands_on_it, "clear_of = \"none\"\n"));
    for (const char* place : {"0.5", "0", "-0.499"}) { // on the ground, half sunk, almost sunk
        TestScene scene(lawn_with_house(std::string("transform = { translate = [0, ") + place + ", 0] }\n"));
        EXPECT_EQ(strands_of(scene, true), 0u) << place;
        EXPECT_TRUE(warns(scene, "strands are left out, because another mesh covers their roots: ")) << place;
        EXPECT_TRUE(warns(scene, " at 'house', one at (")) << place;
        const double left_out = scene.stats.report("roots.covered");
        EXPECT_EQ(double(strands_of(scene, false)) + left_out, double(all)) << place;
        EXPECT_NEAR(left_out, double(all) / 16.0, 0.02 * double(all)) << place;
    }
}

// Roots are placed once, at the motion samples that choose the keys: what is said then must not be lost.
TEST(CoveredRoots, AreNamedOnceWithMotionBlur) {
    TestScene scene(lawn_with_house(stands_on_it, "", "speed = 4\ncollision = { solver = \"exact\" }\n"));
    scene.settings.shutter_open = -0.25;
    scene.settings.shutter_close = 0.25;
    scene.settings.motion_keys = 0; // chosen by the tolerance
    scene.build();
    EXPECT_EQ(std::ranges::count_if(scene.stats.warnings,
                                    [](const Problem& warning) {
                                        return to_string(warning).find(
                                                   "strands are left out, because another mesh "
                                                   "covers their roots: ") != std::string::npos;
                                    }),
              1);
    EXPECT_GT(scene.stats.chosen.at("grass.motion_keys"), 1.0) << "nothing moves";
}

TEST(CoveredRoots, StayWhereNothingCoversThemForGood) {
    const uint64_t all = strands_of(lawn_with_house(stands_on_it, "clear_of = \"none\"\n"));
    const std::string keys = "transform = { keys = [{ frame = 1, translate = [0, 0.5, 0] }, "
                             "{ frame = 9, translate = [9, 0.5, 0] }] }\n";
    EXPECT_EQ(strands_of(lawn_with_house(keys)), all) << "the house drives away";
    EXPECT_EQ(strands_of(lawn_with_house(stands_on_it + "collides = false\n")), all);
    EXPECT_EQ(strands_of(lawn_with_house(stands_on_it, "", "")), all) << "nothing collides";
    EXPECT_EQ(strands_of(lawn_with_house("transform = { translate = [0, 1, 0] }\n")), all) << "on stilts";
    EXPECT_EQ(strands_of(lawn_with_house("transform = { translate = [0, -0.51, 0] }\n")), all) << "buried";
    // An update that moves the house places the roots again.
    TestScene scene(lawn_with_house(stands_on_it));
    EXPECT_EQ(strands_of(scene, true), 0u);
    scene.geometry.meshes[1].transform =
        KeyedTransform(std::vector<double>{1, 1.2, 0.5, 0, 0, 0, 0, 1, 1, 1}, "linear");
    EXPECT_GT(strands_of(scene, true), 0u);
    EXPECT_LT(strands_of(scene, false), all);
}

TEST(CoveredRoots, StayWhereFacesLookAtThem) {
    const uint64_t all = strands_of(lawn_with_house(stands_on_it, "clear_of = \"none\"\n"));
    enum Faces { as_made, turned };
    const auto among = [](const std::string& type, const std::string& more, Faces faces) {
        TestScene scene(lawn_with_house("collides = false\n") + mesh("other", type, more));
        if (faces == turned) flip_sides(scene.geometry.meshes.at(2).mesh); // as flip = true does
        return strands_of(scene, false);
    };
    const auto at = [](const std::string& height, const std::string& more = "") {
        return "transform = { translate = [0, " + height + ", 0]" + more + " }\n";
    };
    const std::string room = "size = [6, 2, 6]\n", land = "size = [9, 9]\n";
    EXPECT_EQ(among("box", room + at("0.99"), turned), all);
    EXPECT_EQ(among("box", room + at("0.99", ", scale = [-1, 1, 1]"), turned), all) << "mirrored";
    EXPECT_EQ(among("box", room + at("1"), turned), all) << "its floor is in the plane of the ground";
    EXPECT_EQ(among("sphere", "radius = 50\n", turned), all);
    EXPECT_EQ(among("box", room + at("0.99"), as_made), 0u);
    // The strands start 0.006 above the ground.
    for (const char* height : {"0", "1e-6", "-1e-6", "0.001", "-0.1"})
        EXPECT_EQ(among("plane", land + at(height), as_made), all) << height;
    EXPECT_EQ(among("plane", land + at("0.005"), as_made), 0u);
    EXPECT_EQ(among("plane", land, turned), 0u);
    EXPECT_EQ(among("box", "size = [9, 1, 9]\n" + at("-0.5"), as_made), all);
}

// Instances have the roots of their mesh: one that is covered here is free there.
TEST(CoveredRoots, StayIfTheMeshHasInstances) {
    const std::string copies = "instances = [{ transform = { translate = [6, 0, 0] } }]\n",
                      collide = "collision = { solver = \"exact\" }\n";
    const uint64_t all = strands_of(lawn_with_house(stands_on_it, "clear_of = \"none\"\n"));
    TestScene scene(lawn_with_house(stands_on_it, "", collide, copies));
    EXPECT_EQ(strands_of(scene, false), 2 * all);
    EXPECT_EQ(scene.stats.report("roots.covered"), 0.0);
    EXPECT_TRUE(warns(scene,
                      " strands stay, though another mesh covers their roots, because the instances of "
                      "'ground' have the same strands: "));
    EXPECT_FALSE(warns(scene, "are left out"));
    for (const char* more : {"clear_of = \"none\"\n", ""}) {
        TestScene quiet(lawn_with_house(*more ? stands_on_it : stands_on_it + "collides = false\n", more,
                                        collide, copies));
        EXPECT_EQ(strands_of(quiet, false), 2 * all);
        EXPECT_FALSE(warns(quiet, "strands stay")) << more;
    }
}

// Roots that lie on another mesh are not free.
TEST(Collision, NamesMeshesAndPlacesWithoutRoom) {
    TestScene scene(lawn_with_house("transform = { translate = [0, 0.51, 0] }\n", "clear_of = \"none\"\n",
                                    "collision = { solver = \"exact\", offset_root = 0.01 }\n"));
    scene.build();
    ASSERT_GT(scene.stats.report("collision.unresolved"), 0.0);
    EXPECT_TRUE(warns(scene, "have no free direction: ")) << to_string(scene.stats.warnings.at(0));
    EXPECT_TRUE(warns(scene, " at 'house', root at (")) << to_string(scene.stats.warnings.at(0));
    EXPECT_TRUE(warns(scene, "move that mesh away from the roots")) << to_string(scene.stats.warnings.at(0));
}

// The attribute "contact" against the counts of collision.
TEST(Collision, TellsWhichSegmentsMeetAMesh) {
    const auto segments = [](TestScene& scene, Contact what) {
        scene.settings.attributes = {"contact"};
        const World world = scene.build();
        const CurveGeometry& curves = world.curves.at(0);
        const std::vector<float>& values = curves.attributes.at(0).values;
        double count = 0.0;
        for (size_t i = 0; i < values.size(); ++i) // a root has the value of its first segment
            count += i % curves.cvs_per_curve != 0 && values[i] == float(what);
        return count;
    };
    const auto ball = [](const std::string& wind) {
        return "\n[wind]\nspeed = 10\nglobal_rotate = 1\nramp_rotate = [[0, 1], [1, 1]]\n" + wind +
               mesh("ball", "sphere", "radius = 0.5\n") + groom("fur", "ball", "count = 600\ncvs = 6\n");
    };
    TestScene blown(ball("collision = { solver = \"exact\" }\n")), through(ball(""));
    const double met = segments(blown, Contact::contact);
    const double contacts = blown.stats.report("collision.contacts"),
                 pushed = blown.stats.report("collision.pushed_out");
    EXPECT_GT(contacts, 0.0);
    EXPECT_GE(met, std::max(contacts, pushed));
    EXPECT_LE(met, contacts + pushed);
    EXPECT_EQ(segments(blown, Contact::unresolved), 0.0);
    EXPECT_EQ(segments(through, Contact::contact), 0.0);
    TestScene stuck(lawn_with_house("transform = { translate = [0, 0.51, 0] }\n", "clear_of = \"none\"\n",
                                    "collision = { solver = \"exact\", offset_root = 0.01 }\n"));
    EXPECT_GT(segments(stuck, Contact::unresolved), 0.0);
    EXPECT_GT(stuck.stats.report("collision.unresolved"), 0.0);
}

TEST(IdleWind, IsToldOnce) {
    const struct {
        const char *wind, *said;
    } cases[] = {
        {"direction = [1, 0, 0]\n", "wind.speed is not given"},
        {"jiggle = { frequency = 2 }\n", "wind.speed is not given"},
        {"speed = 6\nresponse = [[0, 0], [9, 0]]\n", "wind.response is 0 at wind.speed = 6 m/s"},
        {"speed = 6\nglobal_rotate = 0\n", "wind.global_rotate is 0"},
        {"speed = 6\ncalm = 0\n", "wind.calm is 0 and there are no gusts"},
        {"speed = 15\n", "wind.speed = 15 m/s is beyond the end of wind.response: strands bend as at 10 m/s"},
        {"speed = 6\ngusts = { num_gusts = 5, center = [0, 99, 0], extent = [1, 1], distance = 9 }\n",
         "gusts of frames 1 to 48 touches a strand, and wind.calm is 0"},
        {"speed = 6\n[[wind.gusts.control]]\ntransform = { translate = [0, 9, 0] }\n",
         "wind.gusts.control[0]: this gust touches no strand in frames 1 to 48"},
    };
    const std::string two = mesh("ground", "plane") + mesh("hill", "plane") +
                            groom("grass", "ground", "count = 9\n") + groom("fern", "hill", "count = 9\n");
    for (const auto& one : cases) {
        TestScene scene(std::string("\n[wind]\n") + one.wind + two);
        scene.settings.shot_frames = {1.0, 48.0};
        scene.build();
        ASSERT_EQ(scene.stats.warnings.size(), 1u) << one.wind;
        EXPECT_NE(to_string(scene.stats.warnings[0]).find(one.said), std::string::npos)
            << to_string(scene.stats.warnings[0]);
    }
    for (const char* wind :
         {"", "speed = 0\ndirection = [1, 0, 0]\n", "speed = 6\ncalm = 0.5\n",
          "speed = 6\ngusts = { num_gusts = 40 }\n",
          // the gust touches one of the two
          "speed = 6\n[[wind.gusts.control]]\ntransform = { keys = [{ frame = 1, translate = [30, 0, "
          "0] }, { frame = 40, translate = [20, 0, 0] }] }\n"}) {
        TestScene scene(std::string("\n[wind]\n") + wind + mesh("ground", "plane") +
                        mesh("hill", "plane", "transform = { translate = [20, 0, 0] }\n") +
                        groom("grass", "ground", "count = 9\n") + groom("fern", "hill", "count = 9\n"));
        scene.settings.shot_frames = {1.0, 48.0};
        scene.build();
        EXPECT_TRUE(scene.stats.warnings.empty()) << wind << ": " << to_string(scene.stats.warnings[0]);
    }
}

TEST(WindSummary, SaysWhatTheWindDoesInTheShot) {
    TestScene scene("\n[wind]\ndirection = [0, 0, -2]\nspeed = 6\njiggle = { frequency = 2 }\n"
                    "gusts = { num_gusts = 40, radius_range = [1, 2] }\n" +
                    mesh("ground", "plane") + groom("grass", "ground", "count = 9\n"));
    scene.settings.shot_frames = {1.0, 48.0};
    scene.build();
    const std::string text = scene.geometry.procedurals[0]->summarize();
    EXPECT_NE(
        text.find(
            "wind: towards -z, 6 m/s, strength 0.6 of 1 by response\n  between gusts: 0 of that (calm)\n"
            "  gusts: 40 in each 240 frames, "),
        std::string::npos)
        << text;
    EXPECT_NE(text.find(" in the shot touch strands (frames 1 to 48)\n  stages: gusts, bend, jiggle\n"),
              std::string::npos)
        << text;
}

} // namespace marram::testing
