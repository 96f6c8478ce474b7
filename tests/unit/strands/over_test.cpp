// SPDX-License-Identifier: Apache-2.0
// Grass in the air over a dune, and in a stand that slows its own wind, through the renderer's host.
#include "tests/unit/strands/strand_poses.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace marram::testing {
namespace {

// A dune across x: windward side to -x, slip face of 33 degrees to +x, its crest at x = 0.
const std::string dune = R"(
[[curves]]
name = "crest"
type = "points"
points = [[0, 0, 60], [0, 0, -60]]
[[procedural]]
type = "terrain"
name = "dune"
wind.direction = [1, 0, 0]
wind.speed = 6
size = [100, 40]
cell = 0.25
[[procedural.layer]]
type = "dune"
along = "crest"
max_height = 3
slope_width = 15
inner_slope_angle = 33
)";

std::string over_scene(const std::string& wind, const std::string& stand = "density = 2\nwidth = 0.01\n") {
    return "\n[wind]\n" + wind + dune +
           "[[procedural]]\ntype = \"groom\"\nname = \"grass\"\non = \"dune\"\ncvs = 6\nlength = 0.6\nlean = "
           "2\narc = 5\n" +
           stand;
}

// Mean of the tips' way along x over the strands whose roots are at x in [low, high], as a share of their length.
double lean(const Pose& blown, const Pose& rest, double low, double high, size_t cvs = 6) {
    double sum = 0.0;
    size_t count = 0;
    for (size_t c = 0; c < rest.size() / 4 / (cvs + 2); ++c) {
        const float* root = rest.data() + 4 * (c * (cvs + 2) + 1);
        const size_t tip = 4 * (c * (cvs + 2) + cvs);
        if (double(root[0]) < low || double(root[0]) > high) continue;
        sum += double(blown[tip]) - double(rest[tip]);
        ++count;
    }
    EXPECT_GT(count, 50U);
    return sum / double(count) / 0.6;
}

const std::string steady =
    "speed = 6\nresponse = [[0, 0], [20, 1]]\nglobal_rotate = 0.8\nnoise = { amplitude = 0 }\n";

TEST(WindOver, FlattensTheCrestAndLeavesTheLeeStanding) {
    const Pose rest = pose_of_scene(over_scene("speed = 0\n")), flat = pose_of_scene(over_scene(steady)),
               over = pose_of_scene(over_scene(steady + "over = \"dune\"\n"));
    const double level = lean(flat, rest, -45, -35), far_before = lean(over, rest, -45, -35),
                 crest = lean(over, rest, -2, -0.2), lee = lean(over, rest, 2, 6);
    std::printf("lean of level ground %.3f, with the dune's air %.3f far before it, %.3f on its crest, %.3f "
                "in its lee\n",
                level, far_before, crest, lee);
    EXPECT_NEAR(far_before, level, 0.15 * level);
    EXPECT_GT(crest, 1.3 * level);
    EXPECT_LT(std::abs(lee), 0.3 * level);
}

// Rays find the dune's lee, too: with both, the stronger shelter, not their product.
TEST(WindOver, CountsShelterOnce) {
    const std::string rays = "shielding = { shield = 0.5, offset = 40 }\n";
    const std::string over = "over = \"dune\"\n";
    const Pose rest = pose_of_scene(over_scene("speed = 0\n")),
               by_rays = pose_of_scene(over_scene(steady + rays)),
               by_air = pose_of_scene(over_scene(steady + over)),
               by_both = pose_of_scene(over_scene(steady + rays + over));
    size_t checked = 0;
    for (size_t c = 0; c < rest.size() / 32; ++c) {
        const size_t tip = 4 * (c * 8 + 6);
        const auto moved = [&](const Pose& pose) {
            return (Vec3f(pose.data() + tip) - Vec3f(rest.data() + tip)).norm();
        };
        if (moved(by_air) < 0.5F * moved(by_rays)) { // in a bubble
            EXPECT_EQ(Vec3f(by_both.data() + tip), Vec3f(by_air.data() + tip));
            ++checked;
        }
    }
    EXPECT_GT(checked, 100U);
}

// In a wind that turns, with jiggle, gusts and a stand: frames in any order, alone, on one thread have the same bits.
TEST(WindOver, KeepsFramesIndependent) {
    const std::string given = over_scene(
        "over = \"dune\"\nover_height = 10\nspeed = { keys = [[1, 4], [30, 12]] }\n"
        "direction = { keys = [[1, [1, 0, 0]], [30, [0, 0, 1]]] }\ngusts = { num_gusts = 30 }\ncalm = 0.5\n"
        "jiggle = { frequency = 2, damping = 0.3, step = 0.5 }\nshielding = { shield = 0.5, offset = 10 }\n",
        "canopy = true\ndensity = 2\nwidth = 0.1\n");
    expect_independent_frames(given, {7.0, 23.25, 7.5, 12.0, 13.0, 7.0, 13.0}, over_scene(steady));
}

// Ground that moves: the air is that over the ground of the frame.
TEST(WindOver, TakesTheGroundOfItsFrame) {
    const auto scene = [](const std::string& key) {
        return "\n[wind]\nover = \"hill\"\n" + steady +
               "jiggle = { frequency = 2, damping = 0.3, step = 0.5 }\n" +
               mesh("ground", "plane", "size = [60, 60]\n") +
               groom("grass", "ground", "count = 300\ncvs = 6\n") +
               mesh("hill", "sphere",
                    "collides = false\nshelters = false\ntransform = { keys = [{ frame = 1, translate = "
                    "[-30, -8, 0], scale = 10 }, " +
                        key + "] }\n");
    };
    const std::string moves = scene("{ frame = 25, translate = [30, -8, 0], scale = 10 }");
    TestScene moving(moves);
    const Pose before = pose_of(moving, 1.0), later = pose_of(moving, 25.0);
    EXPECT_EQ(later, pose_of_scene(moves, 25.0));
    EXPECT_NE(before, later);
}

TEST(WindOver, SlowsTheWindInAStand) {
    const Pose rest = pose_of_scene(over_scene("speed = 0\n", "density = 40\nwidth = 0.12\n")),
               open = pose_of_scene(over_scene(steady, "density = 40\nwidth = 0.12\n")),
               stand = pose_of_scene(over_scene(steady, "density = 40\nwidth = 0.12\ncanopy = true\n"));
    const double inside = lean(stand, rest, 20, 45), edge = lean(stand, rest, -50, -49.7),
                 without = lean(open, rest, 20, 45);
    std::printf("lean in the open %.3f, at the edge of the stand %.3f, inside %.3f\n", without, edge, inside);
    EXPECT_LT(inside, 0.8 * without);
    EXPECT_GT(edge, 1.1 * inside);
}

// A field that fades to nothing within the past that jiggle reads: another field, far away, changes nothing.
TEST(WindOver, ForgetsFieldsThatHaveFaded) {
    const auto scene = [](const std::string& other) {
        return over_scene(
            "noise = { amplitude = 0 }\nspeed = 4\nresponse = [[0, 0], [10, 0.3], [20, 1]]\n"
            "jiggle = { frequency = 2, damping = 0.3, step = 0.5 }\n"
            "field = [{ velocity = [6, 0, 0], weight = { keys = [[9, 1], [10, 0]], interpolation = "
            "\"constant\" }, transform = { scale = 200 } }" +
                other + "]\n",
            "density = 1\nwidth = 0.05\ncanopy = true\ncanopy_attenuation = 4\n");
    };
    EXPECT_EQ(
        pose_of_scene(scene(""), 12.0),
        pose_of_scene(scene(", { velocity = [1, 0, 0], transform = { translate = [5000, 0, 0] } }"), 12.0));
}

// A strand that hangs below its root stands in the wind, too.
TEST(WindOver, BlowsStrandsThatHang) {
    const std::string hanging =
        over_scene(steady + "over = \"dune\"\nover_height = 10\n", "density = 2\nwidth = 0.01\n");
    const auto bent_over = [&](const std::string& text) {
        std::string changed = text;
        changed.replace(changed.find("arc = 5"), 7, "arc = 200");
        return changed;
    };
    const Pose rest = pose_of_scene(bent_over(over_scene("speed = 0\n"))),
               blown = pose_of_scene(bent_over(hanging));
    size_t moved = 0;
    for (size_t c = 0; c < rest.size() / 32; ++c) moved += blown[4 * (c * 8 + 6)] != rest[4 * (c * 8 + 6)];
    EXPECT_EQ(moved, rest.size() / 32);
}

TEST(WindOver, SaysWhatIsWrong) {
    const std::string wall = mesh("wall", "plane", "transform = { rotate = [90, 0, 0] }\n");
    const std::pair<std::string, const char*> cases[] = {
        {over_scene(steady + "over = \"dunes\"\n"), "there is no mesh or procedural \"dunes\""},
        {over_scene(steady + "over = \"wall\"\n") + wall, "has no area seen from above"},
        {over_scene(steady + "over_height = 10\n"), "wind.over_height is given, and wind.over is not"},
        {over_scene(steady + "over = \"dune\"\nover_roughness = 0\n"), "wind.over_roughness"},
        {over_scene(steady + "over = \"dune\"\nover_roughness = 0.1\n"),
         "no effect without wind.over_height"},
        {over_scene(steady, "density = 2\nwidth = 0\ncanopy = true\n"), "without width or height"},
        {over_scene(steady, "density = 2\nwidth = 0.01\ncanopy_attenuation = 3\n"),
         "canopy_attenuation is given, and canopy is not true"},
        {over_scene(steady, "density = 2\nwidth = 0.01\ncanopy = true\ncanopy_attenuation = 7\n"),
         "canopy_attenuation"},
    };
    for (const auto& [text, message] : cases)
        EXPECT_NE(problems_of_scene(text).find(message), std::string::npos) << message << "\n"
                                                                            << problems_of_scene(text);
}

} // namespace
} // namespace marram::testing
