// SPDX-License-Identifier: Apache-2.0
// Strands in winds whose numbers have keys, through the renderer's host: what a key may change and what not, and
// that frames stay independent of each other.
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

const std::string everything =
    "gusts = { num_gusts = 30, radius_range = [0.3, 0.8], radius_noise_range = 0.2 }\n"
    "calm = 0.4\nnoise = { amplitude = 0.5, frequency = 2, octaves = 2 }\n"
    "shielding = { shield = 0.6, offset = 2 }\n";
const std::string jiggles = "jiggle = { frequency = 2, damping = 0.3, step = 0.5 }\n";

std::string scene_in(const std::string& wind) {
    return "\n[wind]\n" + wind + mesh("ball", "sphere") + groom("fur", "ball", "count = 300\ncvs = 6\n");
}

Pose pose_in(const std::string& wind, double frame) { return pose_of_scene(scene_in(wind), frame); }

// What comes after a key must not reach back before it. (Jiggle looks two of its steps ahead.)
TEST(KeyedWind, ChangesNoBitBeforeAKey) {
    const std::string constant_wind = everything + jiggles + "speed = 3\n";
    const std::string keyed = everything + jiggles + "speed = { keys = [[24, 3], [25, 6]] }\n";
    const std::string turned =
        everything + jiggles + "speed = 3\ndirection = { keys = [[24, [1, 0, 0]], [30, [0, 0, 1]]] }\n";
    const std::string held =
        everything + jiggles +
        "speed = { keys = [[-3, 3], [10, 3], [24, 3], [25, 6]], interpolation = \"smooth\" }\n";
    const std::string gone_on =
        everything + jiggles + "speed = { keys = [[1, 2], [12, 5], [24, 3], [26, 3]] }\n";
    const std::string changed =
        everything + jiggles + "speed = { keys = [[1, 2], [12, 5], [24, 3], [26, 9]] }\n";
    for (const double frame : {-20.0, 1.0, 12.25, 20.0, 23.0}) {
        EXPECT_EQ(pose_in(constant_wind, frame), pose_in(keyed, frame)) << frame;
        EXPECT_EQ(pose_in(constant_wind, frame), pose_in(held, frame)) << frame;
        EXPECT_EQ(pose_in(gone_on, frame), pose_in(changed, frame)) << frame;
    }
    // A wind that turns sends its gusts over all of the bounding sphere, as it must before it turns, too.
    EXPECT_GT(largest_difference(pose_in(turned, 40.0), pose_in(constant_wind, 40.0)), 0.01);
    EXPECT_GT(largest_difference(pose_in(keyed, 26.0), pose_in(constant_wind, 26.0)), 1e-3);
}

// How far CVs move from one of 64 sub-frames to the next: the largest 99th percentile over some frames. (Of
// strands that point against the wind, the bend turns some over in any wind.)
double motion(const std::string& wind, double from, double to) {
    TestScene scene(scene_in(wind));
    Pose before = pose_of(scene, from);
    double most = 0.0;
    for (int i = 1; i <= 64 * (to - from); ++i) {
        const Pose now = pose_of(scene, from + i / 64.0);
        std::vector<double> moves;
        for (size_t v = 0; v + 3 < now.size(); v += 4)
            moves.push_back((Vec3f(now.data() + v) - Vec3f(before.data() + v)).cast<double>().norm());
        std::ranges::nth_element(moves, moves.end() - long(moves.size() / 100));
        most = std::max(most, *(moves.end() - long(moves.size() / 100)));
        before = now;
    }
    return most;
}

// Long after the last key the wind is that of a constant, whatever the first key is; and where it must differ from
// the first key's, it does.
TEST(KeyedWind, HoldsItsLastKey) {
    const std::string still = "noise = { amplitude = 0 }\nglobal_rotate = 0.8\n";
    const std::string plane =
        mesh("wall", "box", "size = [3, 3, 0.1]\ntransform = { translate = [0, 0, -2] }\n");
    const std::string shelter = "speed = 6\ndirection = [0, 0, 1]\nshielding = { offset = 3, shield = ";
    const struct {
        std::string before, keyed, constant, after;
    } cases[] = {
        {still, "speed = { keys = [[1, 0], [24, 7]] }\n", "speed = 7\n", ""},
        {still + "speed = 6\n", "direction = { keys = [[1, [0, 0, 1]], [24, [1, 0, 0.5]]] }\n",
         "direction = [1, 0, 0.5]\n", ""},
        {still + "speed = 6\n", "calm = { keys = [[1, 0], [24, 0.6]] }\n", "calm = 0.6\n", ""},
        {"noise = { amplitude = 0 }\nspeed = 6\n", "global_rotate = { keys = [[1, 0], [24, 0.6]] }\n",
         "global_rotate = 0.6\n", ""},
        {still + "speed = 6\n",
         "ramp_rotate = { keys = [[1, [[0, 0], [1, 0]]], [24, [[0, 0.5], [1, 1]]]] }\n",
         "ramp_rotate = [[0, 0.5], [1, 1]]\n", ""},
        {"speed = 6\nnoise = { amplitude = 1 }\n", "waviness = { keys = [[1, 0], [24, 3]] }\n",
         "waviness = 3\n", ""},
        {"speed = 6\n", "noise = { amplitude = { keys = [[1, 0], [24, 1]] } }\n",
         "noise = { amplitude = 1 }\n", ""},
        {still + "speed = 6\ncalm = 0\n",
         "gusts = { num_gusts = 60, strength = { keys = [[1, 0], [24, 1]] } }\n",
         "gusts = { num_gusts = 60 }\n", ""},
        {still + "speed = 6\ncalm = 0\n",
         "gusts = { control = [{ transform = { scale = 2 }, strength = { keys = [[1, 0], [24, 1]] } }] }\n",
         "gusts = { control = [{ transform = { scale = 2 } }] }\n", ""},
        {still + shelter, "{ keys = [[1, 0], [24, 1]] } }\n", "1 }\n", plane},
        {still + "speed = 6\n",
         "collision = { solver = \"exact\", offset_scale = { keys = [[1, 0], [24, 0.9]] } }\n",
         "collision = { solver = \"exact\", offset_scale = 0.9 }\n", ""},
        {still + "speed = 6\n",
         "response = { keys = [[1, [[0, 0], [3, 0.1], [12, 0.2]]], [24, [[0, 0], [3, 0.4], [12, 0.9]]]] }\n",
         "response = [[0, 0], [3, 0.4], [12, 0.9]]\n", ""},
        {still, "field = [{ swirl = { keys = [[1, 0], [24, 7]] }, transform = { scale = 2 } }]\n",
         "field = [{ swirl = 7, transform = { scale = 2 } }]\n", ""},
    };
    for (const auto& one : cases) {
        TestScene keyed(scene_in(one.before + one.keyed) + one.after),
            constant(scene_in(one.before + one.constant) + one.after);
        const Pose first = pose_of(keyed, 1), last = pose_of(keyed, 300);
        EXPECT_LT(largest_difference(last, pose_of(constant, 300)), 1e-6) << one.keyed;
        EXPECT_GT(largest_difference(last, first), 1e-3) << one.keyed;
    }
    const std::string noisy =
        "speed = 0.01\nresponse = [[0, 0], [0.01, 1]]\nnoise = { amplitude = 1, evolution = ";
    EXPECT_GT(largest_difference(pose_in(noisy + "{ keys = [[1, 0], [24, 2]] } }\n", 60),
                                 pose_in(noisy + "0 }\n", 60)),
              1e-2);
    EXPECT_LT(largest_difference(pose_in(noisy + "{ keys = [[1, 2], [24, 2]] } }\n", 60),
                                 pose_in(noisy + "2 }\n", 60)),
              1e-6);
    // An overdamped spring forgets more slowly than one of less damping.
    const std::string rising =
        still +
        "speed = { keys = [[-100, 1], [1, 9], [30, 2]] }\njiggle = { frequency = 4, step = 0.5, damping = ";
    EXPECT_LT(largest_difference(pose_in(rising + "{ keys = [[-2000, 0.7], [-1900, 10]] } }\n", 20),
                                 pose_in(rising + "10 }\n", 20)),
              2e-3);
}

// A gust is seen before its start frame, while it fades in: it comes from where the wind of that time sends it.
TEST(KeyedWind, SendsGustsWithoutForesight) {
    const std::string gusts = "calm = 0.3\nglobal_rotate = 0.9\ngusts = { num_gusts = 60, radius_range = "
                              "[0.3, 0.8], decay_range = 60, "
                              "start_frame_range = [26, 40], period = 0, distance = 0, extent = [2, 2] }\n";
    for (const double frame : {1.0, 20.0, 23.5})
        EXPECT_EQ(pose_in(gusts + "speed = 3\n", frame),
                  pose_in(gusts + "speed = { keys = [[24, 3], [30, 9]] }\n", frame))
            << frame;
    const std::string one = "speed = 3\ndirection = { keys = [[1, [1, 0, 0]], [24, [1, 0, 0.5]], [30, ",
                      other = one;
    EXPECT_EQ(pose_in(gusts + one + "[0, 0, 1]]] }\n", 23.5),
              pose_in(gusts + other + "[1, 0, -0.5]]] }\n", 23.5));
    EXPECT_GT(largest_difference(pose_in(gusts + "speed = 3\n", 23.5),
                                 pose_in("calm = 0.3\nglobal_rotate = 0.9\nspeed = 3\n", 23.5)),
              1e-3);
}

// Response with keys, half way between them; a wind that is 0 at its first key and 1 at a speed that it has only there.
// Jiggle, whose step and window come from the strongest response, sees all of it.
TEST(KeyedWind, MayRespondOtherwiseInTime) {
    const std::string between = "speed = 6\nresponse = ";
    EXPECT_LT(largest_difference(
                  pose_in(between + "{ keys = [[1, [[0, 0], [12, 0.2]]], [21, [[0, 0], [12, 0.8]]]] }\n", 11),
                  pose_in(between + "[[0, 0], [12, 0.5]]\n", 11)),
              1e-6);
    // Knots may move: a response with its largest at 2 m/s, later at 10, has it at 6 half way.
    const std::string moves =
        "response = { keys = [[1, [[0, 0], [1, 0], [2, 1], [3, 0]]], [21, [[0, 0], [9, 0], [10, "
        "1], [11, 0]]]] }\n";
    EXPECT_GT(largest_difference(pose_in("speed = 6\n" + moves, 11), pose_in("speed = 0\n", 11)), 0.01);
    EXPECT_EQ(pose_in("speed = 6\n" + moves, 1), pose_in("speed = 0\n", 1));
    const std::string wakes = "speed = 6\nresponse = { keys = [[1, [[0, 0], [12, 0]]], [20, [[0, 0], [12, "
                              "0]]], [22, [[0, 0], [12, 1]]]] }\n";
    EXPECT_EQ(pose_in(wakes, 15), pose_in("speed = 0\n", 15));
    EXPECT_GT(largest_difference(pose_in(wakes, 25), pose_in("speed = 0\n", 25)), 0.01);
    const std::string swings = wakes + "jiggle = { frequency = 4, damping = 0.15";
    EXPECT_LT(largest_difference(pose_in(swings + " }\n", 25), pose_in(swings + ", step = 0.0625 }\n", 25)),
              0.02);
}

// A wind that is calm at the moment at which the step of jiggle used to be chosen.
TEST(KeyedWind, HasAStepOfJiggleForItsStorm) {
    const std::string storm =
        "speed = { keys = [[1, 0], [26, 0], [27, 10]] }\nnoise = { amplitude = 0.8, frequency = 4 }\n"
        "jiggle = { frequency = 4, damping = 0.15";
    EXPECT_LT(largest_difference(pose_in(storm + " }\n", 29), pose_in(storm + ", step = 0.0625 }\n", 29)),
              0.02);
}

// At late frames a wind that rode on speed times time would throw noise and gusts about: at frame 2400, a change
// from 6 to 6.05 m/s in a frame would move them by 5 m.
TEST(KeyedWind, MovesWithoutJumps) {
    const double steady = motion(everything + "speed = 8\n", 2399, 2401);
    const struct {
        const char *name, *wind;
        double bound;
    } cases[] = {
        {"a breath more", "speed = { keys = [[2399.5, 8], [2400.5, 8.05]] }\n", 1.2},
        {"doubled", "speed = { keys = [[2399, 4], [2401, 8]] }\n", 2.0},
        {"full turn in 96 frames",
         "speed = 8\ndirection = { keys = [[2352, [1, 0, 0]], [2384, [-1, 0, 2]], [2416, [-1, 0, -2]], "
         "[2448, [1, 0, 0]]] }\n",
         3.0},
        {"stops", "speed = { keys = [[2399, 8], [2401, 0]], interpolation = \"smooth\" }\n", 2.0},
    };
    for (const auto& one : cases) {
        const double most = motion(everything + one.wind, 2399, 2401);
        std::printf("%s: %.2f of the motion of a steady wind of 8 m/s\n", one.name, most / steady);
        EXPECT_LT(most, one.bound * steady) << one.name;
    }
}

TEST(KeyedWind, ThatStopsLeavesStrandsAtRest) {
    const std::string stops = "speed = { keys = [[1, 6], [24, 6], [30, 0]] }\n" + everything;
    EXPECT_EQ(pose_in(stops, 31), pose_in(stops, 77.5));
    const std::string still = everything + "speed = 0\n"; // rest
    EXPECT_EQ(pose_in(stops, 31), pose_in(still, 31));
    EXPECT_LT(largest_difference(pose_in(stops + jiggles, 400), pose_in(still, 31)), 1e-6);
    EXPECT_GT(largest_difference(pose_in(stops + jiggles, 30), pose_in(still, 30)), 1e-3);
}

// A whirl turns strands where it is, as it moves on; strands elsewhere stand in the mean wind, here none.
TEST(WindFields, BlowWhereTheyAre) {
    const std::string whirl =
        "field = [{ shape = \"box\", swirl = 8, mode = \"replace\", transform = { keys = "
        "[{ frame = 1, translate = [-3, 0, 0] }, { frame = 24, translate = [0.6, 0.9, 0], scale = "
        "[0.8, 0.5, 0.8] }] } }]\n";
    const Pose rest = pose_in("speed = 0\n", 24), before = pose_in(whirl, 1), now = pose_in(whirl, 24);
    EXPECT_EQ(rest, before);
    size_t moved = 0, moved_elsewhere = 0;
    for (size_t c = 0; c < 300; ++c) {
        const size_t root = 4 * (c * 8 + 1), tip = 4 * (c * 8 + 6);
        const Vec3d at = Vec3f(rest.data() + root).cast<double>();
        const bool inside =
            std::abs(at.x() - 0.6) < 0.8 && std::abs(at.y() - 0.9) < 0.5 && std::abs(at.z()) < 0.8;
        const bool moves = (Vec3f(now.data() + tip) - Vec3f(rest.data() + tip)).norm() > 0.0F;
        moved += moves && inside;
        moved_elsewhere += moves && !inside;
    }
    EXPECT_GT(moved, 20U);
    EXPECT_EQ(moved_elsewhere, 0U);
}

// Frames in any order, alone, among sub-frames, in one thread: the same bits.
TEST(KeyedWind, KeepsFramesIndependent) {
    const std::string given =
        "speed = { keys = [[1, 2], [20, 9], [40, 1]], interpolation = \"smooth\" }\n"
        "direction = { keys = [[1, [1, 0, 0]], [30, [0, 0.3, 1]]] }\n"
        "calm = { keys = [[1, 0], [30, 0.6]] }\n"
        "response = { keys = [[1, [[0, 0], [5, 0.9], [12, 0.2]]], [30, [[0, 0], [5, 0.1], [12, 1]]]] }\n"
        "global_rotate = { keys = [[1, 0.2], [30, 0.9]] }\n"
        "ramp_rotate = { keys = [[1, [[0, 0], [1, 1]]], [30, [[0, 0.5], [1, 0.2]]]] }\n"
        "waviness = { keys = [[1, 0.5], [30, 2]] }\n"
        "noise = { amplitude = { keys = [[1, 0], [30, 0.9]] }, evolution = { keys = [[1, 0], [30, 2]] } }\n"
        "gusts = { num_gusts = 30, radius_range = [0.3, 0.8], strength = { keys = [[1, 1], [30, 3]] }, "
        "control = [{ strength = { keys = [[1, 0], [30, 1]] } }] }\n"
        "field = [{ swirl = { keys = [[1, 0], [30, 6]] }, transform = { keys = [{ frame = 1 }, { frame = 40, "
        "translate = [0.5, 0, 0] }] } }]\n"
        "shielding = { offset = 2, shield = { keys = [[1, 0], [30, 1]] } }\n"
        "jiggle = { frequency = { keys = [[1, 1], [20, 4]] }, damping = { keys = [[1, 0.3], [30, 0.8]] } }\n"
        "collision = { solver = \"exact\", offset_scale = { keys = [[1, 0.1], [30, 0.8]] } }\n";
    expect_independent_frames(scene_in(given), {7.0, 33.25, 7.5, 12.0, 13.0, 14.0, 40.0, 7.0, 13.0},
                              scene_in(everything + jiggles + "speed = 5\n"));
}

// A measured wind is the same as keys; an entry from the opposite side turns the wind clockwise on the way.
TEST(KeyedWind, MayBeMeasured) {
    const std::string file = ::testing::TempDir() + "marram_record_" + std::to_string(::getpid()) + ".csv";
    std::ofstream(file)
        << "time (s), u10 [km/h], wd\n100, 7.2, 270\n110, 32.4, 270\n120, 14.4, 0\n130, 14.4, 180\n";
    const std::string recorded =
        everything + jiggles + "record = \"" + file + "\"\nrecord_frames = [10, 70]\n";
    const std::string keyed = everything + jiggles +
                              "speed = { keys = [[10, 2], [30, 9], [50, 4], [60, 4], [70, 4]] }\n"
                              "direction = { keys = [[10, [1, 0, 0]], [30, [1, 0, 0]], [50, [0, 0, 1]], "
                              "[60, [-1, 0, 0]], [70, [0, 0, -1]]] }\n";
    for (const double frame : {5.0, 20.0, 45.5, 65.0, 90.0})
        EXPECT_LT(largest_difference(pose_in(recorded, frame), pose_in(keyed, frame)), 1e-5) << frame;
    const std::pair<std::string, const char*> wrong[] = {
        {recorded + "speed = 3\n", "wind.speed is given, and so is wind.record"},
        {everything + "record = \"" + file + "\"\n", "needs the frames at which it begins and ends"},
        {everything + "record = \"" + file + "\"\nrecord_frames = 5\n", "wind.record_frames has no length"},
        {everything + "record_frames = [1, 5]\n", "has no effect without wind.record"},
        {recorded + "speed = 0\n", "wind.speed is given, and so is wind.record"},
        {recorded + "direction = [0, 0, 1]\n", "wind.direction is given, and so is wind.record"},
        {"gusts = { num_gusts = 3, speed_range = 2 }\nrecord = \"" + file + "\"\nrecord_frames = [1, 9]\n",
         "wind.gusts.speed_range is constant, and the wind's speed is not"},
    };
    for (const auto& [wind, message] : wrong) {
        std::string said;
        try {
            TestScene scene(scene_in(wind));
            said = scene.build_errors();
        } catch (const InputError& error) {
            said = to_string(error.problems.at(0));
        }
        EXPECT_NE(said.find(message), std::string::npos) << said;
    }
    std::filesystem::remove(file);
}

TEST(KeyedWind, SaysWhatIsWrong) {
    const auto problems = [](const std::string& wind) { return problems_of_scene(scene_in(wind)); };
    const std::pair<const char*, const char*> cases[] = {
        {"speed = { keys = [] }", "wind.speed.keys is an empty list"},
        {"speed = { keys = [[1, 2], [1, 3]] }", "the frame of key 2 of wind.speed does not ascend"},
        {"speed = { keys = [[1, -2]] }", "the value of key 1 of wind.speed is -2"},
        {"speed = { keys = [[1, 2, 3]] }", "key 1 of wind.speed is a list of 3"},
        {"speed = { keys = [[1, 2]], interpolation = \"cubic\" }", "wind.speed.interpolation"},
        {"speed = { keys = [[1, 2]], extra = 3 }", "wind.speed.extra is unknown"},
        {"noise = { seed = { keys = [[1, 2]] } }", "wind.noise.seed has keys, and is the same at all frames"},
        {"direction = { keys = [[1, [1, 0, 0]], [9, [-2, 0, 0]]] }",
         "the wind turns by more than 170 degrees between frames 1 and 9"},
        {"direction = { keys = [[1, [1, 0, 0]], [9, [0, 0, 0]]] }",
         "the wind's direction is zero at frame 9"},
        {"ramp_rotate = { keys = [[1, [[0, 1]]], [5, [[0, 1], [1, 2]]]] }",
         "has other knots than the first key"},
        {"response = { keys = [[1, [[0, 0], [9, 1]]], [5, [[0, 0.1], [9, 1]]]] }",
         "wind.response may not be 0 at speed 0 around frame 5"},
        {"response = { keys = [[1, [[0, 0], [9, 1]]], [5, [[0, 0], [9, 2]]]] }",
         "wind.response leaves 0 ... 1 at a key"},
        {"response = { keys = [[1, [[0, 0], [9, 1]]], [5, [[-1, 0], [9, 1]]]] }", "may not be 0 at speed 0"},
        {"response = { keys = [[1, [[0, 0], [9, 1]]], [5, [[0, 0], [4, 1], [9, 1]]]] }",
         "has other knots than the first key"},
        {"field = [{ swirl = 3, ramp = [[0, 1]] }]", "wind.field[0].ramp is not 0 at 1"},
        {"field = [{ swirl = 3, type = \"vortex\" }]", "wind.field[0].type is unknown"},
        {"speed = { keys = [[1, 2], [9, 3]] }\nnoise = { loop = [1, 24] }",
         "wind.noise.loop repeats the noise, and the air that carries it has keys"},
        {"speed = { key = [[1, 2]] }", "wind.speed is a table without keys: give a number"},
        {"jiggle = { frequency = { keys = [[1, 2], [9, 0]] } }", "jiggle.frequency is 0 at a key"},
        {"jiggle = { frequency = { keys = [[1, 0], [9, 2]] } }", "jiggle.frequency is 0 at a key"},
        {"jiggle = { frequency = 2, damping = { keys = [[1, 0.2], [9, 0]] } }",
         "jiggle.damping is 0 at a key"},
        {"speed = { keys = [[1, 2], [9, 3]] }\ngusts = { num_gusts = 3, speed_range = 3 }",
         "wind.gusts.speed_range is constant, and the wind's speed is not"},
    };
    for (const auto& [wind, message] : cases)
        EXPECT_NE(problems(wind).find(message), std::string::npos) << wind << "\n" << problems(wind);
}

} // namespace
} // namespace marram::testing
