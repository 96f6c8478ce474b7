// SPDX-License-Identifier: Apache-2.0
// Strands that feel fields at each CV, not at their roots.
#include "tests/unit/strands/strand_poses.h"

#include <gtest/gtest.h>

#include <string>

namespace marram::testing {
namespace {

// Strands of 1 m. Above 0.5 m the wind blows the other way.
std::string layered(const std::string& wind, const std::string& groom, bool with_field = true) {
    return "\n[wind]\nspeed = 6\nresponse = [[0, 0], [10, 1]]\nnoise = { amplitude = 0 }\n" + wind +
           (with_field
                ? "[[wind.field]]\nshape = \"box\"\nmode = \"replace\"\nvelocity = [-6, 0, 0]\n"
                  "ramp = [[0, 1], [0.9, 1], [1, 0]]\n"
                  "transform = { keys = [{ frame = 1, translate = [0, 5.5, 0], scale = [9, 5, 9] }] }\n"
                : "") +
           R"(
[[mesh]]
name = "ground"
type = "plane"
size = [2, 2]
[[procedural]]
type = "groom"
name = "grass"
on = "ground"
density = 50
cvs = 9
length = 1
width = 0.01
)" + groom;
}

constexpr size_t cvs = 9;

// Mean way along x of a CV from rest.
double way(const Pose& pose, const Pose& rest, size_t cv) {
    double sum = 0.0;
    const size_t count = rest.size() / 4 / (cvs + 2);
    for (size_t c = 0; c < count; ++c) {
        const size_t at = 4 * (c * (cvs + 2) + 1 + cv);
        sum += double(pose[at]) - double(rest[at]);
    }
    return sum / double(count);
}

const std::string blade = "bend = \"blade\"\nblade = { stiffness = 5e-3, mass = 1e-4 }\n";

TEST(FieldsAt, RootsDoNotFeelAFieldAboveThem) {
    for (const std::string& groom : {std::string(), blade})
        EXPECT_EQ(pose_of_scene(layered("", groom)), pose_of_scene(layered("", groom, false)));
}

TEST(FieldsAt, CvsFeelItWhereTheyAre) {
    for (const std::string& groom : {std::string("lean = 20\n"), blade}) {
        const Pose rest = pose_of_scene(layered("global_rotate = 0\ncalm = 0\n", groom, false)),
                   below = pose_of_scene(layered("", groom)),
                   both = pose_of_scene(layered("fields_at = \"cv\"\n", groom));
        EXPECT_GT(way(below, rest, 2), 0.0);
        EXPECT_LT(way(both, rest, cvs - 1), way(below, rest, cvs - 1) - 0.03) << groom;
    }
}

TEST(FieldsAt, WithoutFieldsItIsRefused) {
    EXPECT_NE(problems_of_scene(layered("fields_at = \"cv\"\n", "", false)).find("the wind has no fields"),
              std::string::npos);
    EXPECT_EQ(problems_of_scene(layered("fields_at = \"root\"\n", "")), "");
}

TEST(FieldsAt, FramesAreIndependent) {
    const std::string jiggle = "fields_at = \"cv\"\njiggle = { frequency = 2, damping = 0.3 }\n";
    expect_independent_frames(layered(jiggle, blade), {3, 9, 4, 9.5}, layered("", blade));
}

} // namespace
} // namespace marram::testing
