// SPDX-License-Identifier: Apache-2.0
// --frames: what a list means, what errors it can have and where, and that render and bake produce its
// frames.
#include "program.h"

#include "core/shot/frame_list.h"

#include <nlohmann/json.hpp>

namespace marram::testing {
namespace {

using Frames = std::vector<double>;

std::string refusal_of(const std::string& list) {
    try {
        parse_frames(list);
    } catch (const InputError& error) {
        EXPECT_EQ(error.problems.size(), 1u);
        return error.what();
    }
    return "";
}

TEST(FrameList, IsRangesStepsAndFrames) {
    EXPECT_EQ(parse_frames("7"), Frames{7});
    EXPECT_EQ(parse_frames("1-3"), (Frames{1, 2, 3}));
    EXPECT_EQ(parse_frames("3-3"), Frames{3});
    EXPECT_EQ(parse_frames("1-100x25,120"), (Frames{1, 26, 51, 76, 120}));
    EXPECT_EQ(parse_frames("1-10x9"), (Frames{1, 10}));
    EXPECT_EQ(parse_frames("1-2x100"), Frames{1});
    EXPECT_EQ(parse_frames("-3--1,-0"), (Frames{-3, -2, -1, 0}));
    EXPECT_EQ(parse_frames("-1-1"), (Frames{-1, 0, 1}));
    EXPECT_EQ(parse_frames("120,1-2"), (Frames{120, 1, 2})) << "in the order of the list";
}

// Frames are the same to the bit as in `--frame 0.3`: sums of 0.1 would give other frames and file names.
TEST(FrameList, CountsFractionsExactly) {
    EXPECT_EQ(parse_frames("7.25"), Frames{7.25});
    EXPECT_EQ(parse_frames("0-1x0.1"), (Frames{0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1}));
    EXPECT_EQ(parse_frames("1.5-3"), (Frames{1.5, 2.5}));
    EXPECT_EQ(parse_frames("-0.5-0.5x.5"), (Frames{-0.5, 0, 0.5}));
    EXPECT_EQ(parse_frames("999999998.999999-1000000000x0.5"),
              (Frames{999999998.999999, 999999999.499999, 999999999.999999}));
}

TEST(FrameList, DoesEachFrameOnce) {
    EXPECT_EQ(parse_frames("1-3,2-5,1,1.0"), (Frames{1, 2, 3, 4, 5}));
    EXPECT_EQ(parse_frames("3,1-3"), (Frames{3, 1, 2}));
    EXPECT_EQ(parse_frames("0.5-1.5x0.5,1"), (Frames{0.5, 1, 1.5}));
}

TEST(FrameList, SaysWhatIsWrongAndWhere) {
    const std::map<std::string, std::string> refused = {
        {"", "--frames : the frame is missing: give frames and ranges, such as 1-24 or 1-100x5,120"},
        {"1-10,", "the frame is missing (character 6)"},
        {"1,,2", "',2' is no frame (character 3)"},
        {"1-", "the last frame of the range is missing (character 3)"},
        {"1-10,20-x", "'x' is no last frame of the range (character 9)"},
        {"1-10x", "the step is missing (character 6)"},
        {"1-10xx", "'x' is no step (character 6)"},
        {"1-10x0", "the step is not above 0 (character 6)"},
        {"1,2-10x-2", "the step is not above 0 (character 8)"},
        {"1-10x0.0000001", "0.0000001 has more than six decimals (character 6)"},
        {"4,5x2", "a step belongs to a range (character 4)"},
        {"1-3,9-7", "the range 9-7 goes backwards (character 5): write 7-9"},
        {"1 - 3", "' - 3' is not expected here (character 2): separate frames and ranges by commas"},
        {"1-2-3", "'-3' is not expected here (character 4)"},
        {"1e3", "'e3' is not expected here (character 2)"},
        {"1,inf", "'inf' is no frame (character 3)"},
        {"nan", "--frames nan: 'nan' is no frame: give"},
        {"2000000000", "--frames 2000000000: 2000000000 is too large: give frames from"},
        {std::string(400, '9'), ": give frames from"},
        {"1-1000001", "--frames 1-1000001: these are more than 1000000 frames: render them in several runs"},
        {"-1000000000-1000000000x0.000001", "these are more than 1000000 frames"},
        {"0,1-1000000", "these are more than 1000000 frames (character 3)"},
    };
    for (const auto& [list, message] : refused) EXPECT_CONTAINS(refusal_of(list), message);
    EXPECT_EQ(parse_frames("1-1000000").size(), 1'000'000u);
}

TEST(FrameList, IsRenderedAndResumed) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{.film = "size = [4, 4]\nsamples = 1\n"});
    const std::vector<std::string> command = {"render",    scene,
                                              "-o",        folder / "f.##.exr",
                                              "--frames",  "5,1-3x2,5,2.5",
                                              "--stats",   folder / "s.##.json",
                                              "--preview", folder / "p.##.png"};
    const ProgramResult done = marram(command);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(lines(done.out), (std::vector<std::string>{folder / "f.05.exr", folder / "f.01.exr",
                                                         folder / "f.03.exr", folder / "f.02.5.exr"}));
    std::set<std::string> expected = {"a.toml"};
    for (const char* frame : {"01", "02.5", "03", "05"})
        expected.insert({fmt::format("f.{}.exr", frame), fmt::format("s.{}.json", frame),
                         fmt::format("p.{}.png", frame)});
    EXPECT_EQ(folder.names(), expected);
    fs::remove(folder / "f.03.exr");
    std::vector<std::string> again = command;
    again.emplace_back("--resume");
    const ProgramResult resumed = marram(again);
    EXPECT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_EQ(lines(resumed.out), std::vector<std::string>{folder / "f.03.exr"});
}

TEST(FrameList, IsBaked) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const ProgramResult done = marram({"bake", scene, "-o", folder / "b.##.hair", "--frames", "1-5x4,1,2.5",
                                       "--stats", folder / "s.json", "--colliders", folder / "c.##.obj"});
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(lines(done.out),
              (std::vector<std::string>{folder / "b.01.hair", folder / "b.05.hair", folder / "b.02.5.hair"}));
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", "b.01.hair", "b.05.hair", "b.02.5.hair",
                                                     "c.01.obj", "c.05.obj", "c.02.5.obj", "s.json"}));
    const nlohmann::json stats = nlohmann::json::parse(read_file(folder / "s.json"));
    ASSERT_EQ(stats.size(), 3u);
    EXPECT_EQ(stats[2]["frame"], 2.5);
    EXPECT_DONE(marram({"bake", scene, "-o", folder / "one.##.hair", "--frame", "5"}));
    EXPECT_EQ(read_file(folder / "one.05.hair"), read_file(folder / "b.05.hair"));
    EXPECT_NE(read_file(folder / "b.01.hair"), read_file(folder / "b.05.hair"));
    EXPECT_DONE(marram({"bake", scene, "-o", folder / "first.##.hair"}));
    EXPECT_EQ(read_file(folder / "first.01.hair"), read_file(folder / "b.01.hair"))
        << "the scene's first frame alone";
    EXPECT_FALSE(fs::exists(folder / "first.02.hair"));
}

} // namespace
} // namespace marram::testing
