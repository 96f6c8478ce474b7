// SPDX-License-Identifier: Apache-2.0
// Strands that bend as elastic blades: their natural frequency, and how they stand in the wind through the renderer's
// host. elastica_test.cpp has the equations themselves.
#include "procedural/wind/blade/blade.h"
#include "tests/unit/strands/strand_poses.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace marram::testing {
namespace {

std::string blade_scene(const std::string& wind, const std::string& blade, const std::string& strands = "") {
    return "\n[wind]\nnoise = { amplitude = 0 }\n" + wind + mesh("ground", "plane", "size = [4, 4]\n") +
           "[[procedural]]\ntype = \"groom\"\nname = \"grass\"\non = \"ground\"\ncount = 200\nlength = "
           "0.5\nwidth = 0.005\n"
           "shape = \"ribbon\"\nlean = 5\narc = 10\nwidth_profile = [[0, 1]]\nwidth_variation = 0\n" +
           (strands.empty() ? "cvs = 8\n" : strands) + blade;
}

// Mean way of the tips along x, in lengths.
double mean_lean(const Pose& pose, const Pose& rest, size_t cvs = 8) {
    double sum = 0.0;
    const size_t strands = pose.size() / 4 / (cvs + 2);
    for (size_t c = 0; c < strands; ++c)
        sum += double(pose[4 * (c * (cvs + 2) + cvs)]) - double(rest[4 * (c * (cvs + 2) + cvs)]);
    return sum / double(strands) / 0.5;
}

const std::string stiff = "bend = \"blade\"\nblade = { stiffness = 2e-4, mass = 0.0008 }\n";

TEST(Blade, HasTheFrequencyOfACantilever) {
    Blade blade;
    blade.rigidity = 3e-4;
    blade.mass = 0.005;
    const auto scaled = [&](double length) { // of omega, in sqrt(EI / m) / L^2
        return natural_frequency(blade, length) * 2.0 * pi * length * length /
               std::sqrt(blade.rigidity / blade.mass);
    };
    const Ramp whole(std::array{0.0, 1.0}, "linear"), point(std::array{0.0, 1.0, 1.0, 0.0}, "linear");
    blade.taper = blade.mass_taper = whole;
    EXPECT_NEAR(scaled(0.7), 3.51602, 4e-4); // the square of 1.875104
    // Of constant thickness, as wide as a triangle; its rigidity keeps a thousandth.
    blade.taper = Ramp(std::array{0.0, 1.0, 0.999, 0.001}, "linear");
    blade.mass_taper = point;
    std::printf("frequencies: uniform %.4f, triangle %.4f (7.16)\n", 3.51602, scaled(0.7));
    EXPECT_NEAR(scaled(0.7), 7.157, 0.03);
}

TEST(Blade, StandsAsGroomedInStillAir) {
    const Pose rest = pose_of_scene(blade_scene("speed = 0\n", ""));
    EXPECT_EQ(pose_of_scene(blade_scene("speed = 0\n", stiff)), rest);
    EXPECT_EQ(pose_of_scene(blade_scene("speed = { keys = [[1, 0], [24, 9]] }\n", stiff)), rest);
    // Weight bends it further if it was groomed without.
    const Pose sagged = pose_of_scene(blade_scene(
        "speed = 0\n", "bend = \"blade\"\nblade = { stiffness = 2e-3, mass = 0.008, sags = true }\n"));
    EXPECT_GT(largest_difference(sagged, rest), 0.01);
}

// Drag grows with the square of the speed while a blade stands, and much less when it lies.
TEST(Blade, LeansWithTheWindAndLiesDown) {
    const Pose rest = pose_of_scene(blade_scene("speed = 0\n", ""));
    std::vector<double> leans;
    for (const double speed : {0.1, 0.2, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0})
        leans.push_back(
            mean_lean(pose_of_scene(blade_scene("speed = " + std::to_string(speed) + "\n", stiff)), rest));
    std::printf("lean at 0.1 to 40 m/s, in lengths:");
    for (const double lean : leans) std::printf(" %.3f", lean);
    std::printf("\n");
    EXPECT_NEAR(leans[1] / leans[0], 4.0, 0.3);
    for (size_t i = 0; i + 1 < leans.size(); ++i) EXPECT_GT(leans[i + 1], leans[i]);
    EXPECT_LT(leans[7] - leans[6], 0.15);
    // More CVs show the same blade.
    const std::string wind = "speed = 6\n";
    const Pose fine_rest = pose_of_scene(blade_scene("speed = 0\n", "", "cvs = 29\n"));
    const double coarse = mean_lean(pose_of_scene(blade_scene(wind, stiff)), rest),
                 fine = mean_lean(pose_of_scene(blade_scene(wind, stiff, "cvs = 29\n")), fine_rest, 29);
    EXPECT_NEAR(coarse, fine, 2e-3);
}

TEST(Blade, IsAsStiffAsItsFrequencySays) {
    const Pose rest = pose_of_scene(blade_scene("speed = 0\n", ""));
    Blade blade;
    blade.rigidity = 2e-4;
    blade.mass = 0.0008;
    blade.taper = blade.mass_taper = Ramp(std::array{0.0, 1.0}, "linear");
    const std::string by_frequency = "bend = \"blade\"\nblade = { mass = 0.0008, frequency = " +
                                     std::to_string(natural_frequency(blade, 0.5)) + " }\n";
    const std::string wind = "speed = 6\n";
    EXPECT_LT(largest_difference(pose_of_scene(blade_scene(wind, by_frequency)),
                                 pose_of_scene(blade_scene(wind, stiff))),
              1e-4);
    // E w t^3 / 12 = 2e-4.
    const std::string by_modulus =
        "bend = \"blade\"\nblade = { mass = 0.0008, modulus = 1.92e9, thickness = 6.30e-4 }\n";
    EXPECT_LT(largest_difference(pose_of_scene(blade_scene(wind, by_modulus)),
                                 pose_of_scene(blade_scene(wind, stiff))),
              1e-2);
}

// A strand half as wide by its profile is one half as wide; keys of the talk's dials have no effect.
TEST(Blade, IsMeasuredAtItsRoot) {
    const std::string wind = "speed = 6\n",
                      of_matter = "bend = \"blade\"\nblade = { modulus = 2e9, density = 700 }\n";
    const auto round = [&](const std::string& wind_text, const std::string& profile) {
        std::string text = blade_scene(wind_text, of_matter);
        text.replace(text.find("shape = \"ribbon\""), 16, "shape = \"round\"");
        text.replace(text.find("width = 0.005"), 13, profile.substr(0, profile.find('|')));
        text.replace(text.find("width_profile = [[0, 1]]"), 24, profile.substr(profile.find('|') + 1));
        return pose_of_scene(text, 5.0);
    };
    const Pose half = round(wind, "width = 0.005|width_profile = [[0, 0.5]]");
    EXPECT_LT(largest_difference(half, round(wind, "width = 0.0025|width_profile = [[0, 1]]")), 1e-4);
    EXPECT_EQ(
        half,
        round(wind +
                  "global_rotate = { keys = [[1, 0], [10, 1]] }\nresponse = { keys = [[1, [[0, 0], [9, 1]]], "
                  "[9, [[0, 0], [9, 0]]]] }\n",
              "width = 0.005|width_profile = [[0, 0.5]]"));
    // The strongest of several speeds counts, whatever the response.
    EXPECT_LT(largest_difference(round("speed = 9\n", "width = 0.005|width_profile = [[0, 1]]"),
                                 round("speed = { keys = [[-90, 12], [-50, 30], [-20, 9]] }\n",
                                       "width = 0.005|width_profile = [[0, 1]]")),
              2e-3);
}

// A species fills in what is not given; what is given wins.
TEST(Blade, MayBeOfASpecies) {
    const std::string wind = "speed = 6\n", hair = "bend = \"blade\"\nblade = { species = \"hair\"";
    const auto numbers = [](const std::string& blade) {
        return "bend = \"blade\"\nblade = { " + blade + " }\n";
    };
    for (const bool round : {true, false}) {
        const auto pose = [&](const std::string& blade) {
            std::string text = blade_scene(wind, blade);
            text.replace(text.find("width = 0.005"), 13, "width = 7e-5");
            if (round) text.replace(text.find("shape = \"ribbon\""), 16, "shape = \"round\"");
            return pose_of_scene(text);
        };
        const std::string thick = round ? "" : ", thickness = 7e-5";
        const Pose preset = pose(hair + " }\n");
        EXPECT_EQ(preset, pose(numbers("modulus = 3.9e9, density = 1310, drag = 2" + thick)));
        EXPECT_NE(preset, pose(""));
        EXPECT_EQ(pose(hair + ", modulus = 1e9 }\n"),
                  pose(numbers("modulus = 1e9, density = 1310, drag = 2" + thick)));
        EXPECT_EQ(pose(hair + ", mass = 1e-5, drag = 1 }\n"),
                  pose(numbers("modulus = 3.9e9, mass = 1e-5, drag = 1" + thick)));
        EXPECT_EQ(pose(hair + ", frequency = 2 }\n"),
                  pose(numbers("frequency = 2, density = 1310, drag = 2" + thick)));
    }
}

// Jiggle without a frequency takes the blade's; frames in any order, alone, on one thread have the same bits.
TEST(Blade, SwingsAtItsFrequencyAndKeepsFramesIndependent) {
    const std::string stiffer = "bend = \"blade\"\nblade = { stiffness = 4e-3, mass = 0.0008 }\n";
    Blade blade;
    blade.rigidity = 4e-3;
    blade.mass = 0.0008;
    blade.taper = blade.mass_taper = Ramp(std::array{0.0, 1.0}, "linear");
    const std::string wind =
        "speed = { keys = [[1, 2], [12, 9]] }\ndirection = { keys = [[1, [1, 0, 0]], [24, [0, 0, 1]]] }\n"
        "gusts = { num_gusts = 20 }\ncalm = 0.5\nfield = [{ swirl = 4, transform = { scale = 2 } }]\n";
    const std::string swings = blade_scene(wind + "jiggle = { damping = 0.5, step = 0.5 }\n", stiffer);
    const std::string given = blade_scene(wind + "jiggle = { damping = 0.5, step = 0.5, frequency = " +
                                              std::to_string(natural_frequency(blade, 0.5)) + " }\n",
                                          stiffer);
    EXPECT_LT(largest_difference(pose_of_scene(swings, 20.0), pose_of_scene(given, 20.0)), 1e-4);
    expect_independent_frames(swings, {7.0, 20.25, 7.5, 12.0, 13.0, 7.0}, blade_scene("speed = 5\n", stiff));
}

// A tolerance that differs from frame to frame, as where the camera moves: what jiggle keeps is not of another one.
TEST(Blade, KeepsNothingOfAnotherTolerance) {
    const std::string text = blade_scene(
        "speed = 6\ngusts = { num_gusts = 20 }\ncalm = 0.5\njiggle = { damping = 0.5, step = 0.5 }\n",
        "bend = \"blade\"\nblade = { stiffness = 1e-3, mass = 0.0008 }\n");
    const auto at = [](TestScene& scene, double frame) {
        scene.settings.tolerance = frame < 12.0 ? 1e-3 : 1e-5;
        return pose_of(scene, frame);
    };
    TestScene in_order(text), alone(text);
    for (const double frame : {10.0, 11.0}) at(in_order, frame);
    EXPECT_EQ(at(in_order, 12.0), at(alone, 12.0));
}

TEST(Blade, SaysWhatIsWrong) {
    const auto problems = [](const std::string& blade) {
        return problems_of_scene(blade_scene("speed = 3\n", blade));
    };
    const std::pair<const char*, const char*> cases[] = {
        {"bend = \"blade\"\n", "0 are given: give one of blade.stiffness"},
        {"bend = \"blade\"\nblade = { stiffness = 1, frequency = 2, mass = 1 }\n", "2 are given"},
        {"bend = \"blade\"\nblade = { stiffness = 1 }\n", "give either blade.mass"},
        {"bend = \"blade\"\nblade = { modulus = 1e9, mass = 1 }\n", "needs its thickness"},
        {"bend = \"blade\"\nblade = { stiffness = -1, mass = 1 }\n", "blade.stiffness"},
        {"bend = \"blade\"\nblade = { stiffness = 1, mass = 1, taper = [[0, 0], [1, 1]] }\n",
         "blade.taper is 0 at the root"},
        {"bend = \"blade\"\nblade = { stiffness = 1, mass = 1, thickness = 1e-3 }\n",
         "blade.thickness has no effect"},
        {"blade = { stiffness = 1, mass = 1 }\n", "bend is not \"blade\""},
        {"bend = \"reed\"\n", "bend"},
        {"bend = \"blade\"\nblade = { species = \"reed\" }\n", "hair"},
        {"blade = { species = \"hair\" }\n", "bend is not \"blade\""},
        {"bend = \"blade\"\nblade = { species = \"hair\", modulus = 1e9, stiffness = 1 }\n", "2 are given"},
        {"bend = \"blade\"\nblade = { species = \"hair\", stiffness = 1, mass = 1, thickness = 1e-3 }\n",
         "blade.thickness has no effect"},
    };
    for (const auto& [blade, message] : cases)
        EXPECT_NE(problems(blade).find(message), std::string::npos) << blade << problems(blade);
}

} // namespace
} // namespace marram::testing
