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

TEST(FrameList, HasFramesThatAStepLeavesOut) {
    EXPECT_EQ(parse_frames("1-10y3"), (Frames{2, 3, 5, 6, 8, 9}));
    EXPECT_EQ(parse_frames("1-10y3,1-10x3"), (Frames{2, 3, 5, 6, 8, 9, 1, 4, 7, 10}));
    EXPECT_EQ(parse_frames("-3-3y2"), (Frames{-2, 0, 2}));
    EXPECT_CONTAINS(refusal_of("1-10y1"), "the step of 1-10y1 leaves no frame out: A-ByN has");
    EXPECT_CONTAINS(refusal_of("5-5y2"), "leaves no frame out");
    EXPECT_CONTAINS(refusal_of("1-10y1.5"), "after 'y' a whole number is needed (character 6)");
    EXPECT_CONTAINS(refusal_of("1-10y0"), "the step is not above 0 (character 6)");
    EXPECT_CONTAINS(refusal_of("5y3"), "a step belongs to a range (character 2)");
}

TEST(FrameList, MayBePadded) {
    EXPECT_EQ(parse_frames("0001-0003,-0002,00"), (Frames{1, 2, 3, -2, 0}));
    EXPECT_EQ(parse_frames("-0003--0001"), (Frames{-3, -2, -1}));
}

// What others write means what it means to them, once it is said who they are.
TEST(FrameList, HasDialects) {
    const auto frames = [](const std::string& list, FrameDialect dialect) {
        return parse_frames(list, "--frames", dialect);
    };
    using enum FrameDialect;
    EXPECT_EQ(frames("1-10:5", opencue), (Frames{1, 6, 2, 4, 8, 10, 3, 5, 7, 9}))
        << "as its documentation has it";
    EXPECT_EQ(frames("1-10:2", opencue), (Frames{1, 3, 5, 7, 9, 2, 4, 6, 8, 10}));
    EXPECT_EQ(frames("10-1x-3", opencue), (Frames{10, 7, 4, 1}));
    EXPECT_EQ(frames("10-1y-3", opencue), (Frames{9, 8, 6, 5, 3, 2}));
    EXPECT_EQ(frames("3-1", opencue), (Frames{3, 2, 1}));
    EXPECT_EQ(frames("4-1:-2", opencue), (Frames{4, 2, 3, 1}));
    EXPECT_EQ(frames("1-10:2", openjd), (Frames{1, 3, 5, 7, 9}));
    EXPECT_EQ(frames("10-1:-4", openjd), (Frames{10, 6, 2}));
    EXPECT_EQ(frames("1-3,10-12:2", openjd), (Frames{1, 2, 3, 10, 12}));
    EXPECT_EQ(frames("1-10:3", fileseq), (Frames{1, 4, 7, 10, 3, 5, 9, 2, 6, 8}));
    EXPECT_EQ(frames("1-3:1000000000", fileseq), (Frames{1, 3, 2}));
    EXPECT_EQ(frames("1-1000000:1000", opencue).size(), 1'000'000u);
    EXPECT_EQ(frames("1-100000:1000", fileseq).size(), 100'000u);
    const auto refusal = [&](const std::string& list, FrameDialect dialect) -> std::string {
        try {
            frames(list, dialect);
        } catch (const InputError& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(
        refusal_of("1-10:2"),
        "--frames 1-10:2: ':' is read in several ways: in OpenJD it is a step, in OpenCue an interleaved "
        "order, in fileseq a staggered one (character 5): write a step as 1-10x2, or choose with "
        "--frames-dialect");
    EXPECT_CONTAINS(refusal("10-1", openjd), "the range 10-1 goes backwards: write 1-10");
    EXPECT_CONTAINS(refusal("10-1:2", openjd),
                    "the step of a range that goes backwards is not below 0 (character 6)");
    EXPECT_CONTAINS(refusal("1-10:-2", opencue), "the step is not above 0 (character 6)");
    EXPECT_CONTAINS(refusal("1-10:0", fileseq), "the step is not above 0");
    EXPECT_CONTAINS(refusal("1-10:0.5", opencue), "after ':' a whole number is needed");
    EXPECT_CONTAINS(refusal("1-1000001:5", opencue), "these are more than 1000000 frames");
    EXPECT_CONTAINS(refusal("5:3", fileseq), "a step belongs to a range (character 2)");
}

TEST(FrameList, LeavesOutWhatTheSceneHasNot) {
    FrameRequest request;
    Frames frames = {-1, 0.5, 1, 5, 10, 10.5, 12};
    EXPECT_EQ(skip_frames_outside(frames, request, {1, 10}), "");
    EXPECT_EQ(frames.size(), 7u) << "only on request";
    request.skip_outside = true;
    EXPECT_EQ(skip_frames_outside(frames, request, {1, 10}),
              "--skip-outside: 4 frames, -1 to 12, are skipped: the scene has frames 1 to 10");
    EXPECT_EQ(frames, (Frames{1, 5, 10}));
    EXPECT_EQ(skip_frames_outside(frames, request, {1, 10}), "");
    EXPECT_EQ(skip_frames_outside(frames, request, {2, 10}),
              "--skip-outside: frame 1 is skipped: the scene has frames 2 to 10");
}

// A chunk that runs past the last frame, and one that lies behind it.
TEST(FrameList, OfAChunkMayRunPastTheEnd) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{.film = "size = [4, 4]\nsamples = 1\n"});
    for (const auto& [command, name] : {std::pair{"render", "f.##.exr"}, std::pair{"bake", "f.##.hair"}}) {
        const ProgramResult some = marram({command, scene, "-o", folder / name, "--frames", "9-11:2",
                                           "--frames-dialect", "opencue", "--skip-outside"});
        EXPECT_EQ(some.code, 0);
        EXPECT_EQ(some.err, "--skip-outside: frame 11 is skipped: the scene has frames 1 to 10\n");
        EXPECT_EQ(lines(some.out).size(), 2u) << some.out;
        const auto before = folder.names();
        const ProgramResult none = marram({command, scene, "-o", folder / name, "--frames", "11-20",
                                           "--skip-outside", "--progress", "plain"});
        EXPECT_EQ(none.code, 0);
        EXPECT_EQ(none.err,
                  "--skip-outside: 10 frames, 11 to 20, are skipped: the scene has frames 1 to 10\n");
        EXPECT_TRUE(none.out.ends_with("100%\n")) << none.out;
        EXPECT_EQ(folder.names(), before);
    }
    const ProgramResult watched =
        marram({"render", scene, "-o", folder / "w.exr", "--frame", "11", "--watch", "--skip-outside"});
    EXPECT_EQ(watched.code, 2);
    EXPECT_CONTAINS(watched.err, "--watch: it renders one frame, and these are 0");
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

// The list is that of --resume: the same scene and settings, in the order of the frames. It makes no file.
TEST(FrameList, SaysWhatIsThere) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const auto list = [&](const std::string& frames, const std::vector<std::string>& more) {
        std::vector<std::string> command = {"render",   scene,  "-o",     folder / "f.##.exr",
                                            "--frames", frames, "--list", "--spp"};
        command.insert(command.end(), more.begin(), more.end());
        const std::set<std::string> before = folder.names();
        const ProgramResult done = marram(command);
        EXPECT_EQ(done.code, 0) << done.err;
        EXPECT_EQ(folder.names(), before);
        std::vector<std::pair<std::string, bool>> there;
        for (const std::string& line : lines(done.out)) {
            const nlohmann::json frame = nlohmann::json::parse(line);
            there.emplace_back(frame.at("frame"), frame.at("there"));
            EXPECT_FALSE(frame.contains("parts"));
        }
        return there;
    };
    using There = std::vector<std::pair<std::string, bool>>;
    EXPECT_DONE(
        marram({"render", scene, "-o", folder / "f.##.exr", "--frames", "-1,2.5", "--spp", "2", "--quiet"}));
    EXPECT_EQ(list("3,2.5,-1-0", {"2"}), (There{{"3", false}, {"2.5", true}, {"-1", true}, {"0", false}}));
    EXPECT_EQ(list("2.5", {"3"}), (There{{"2.5", false}}));
    EXPECT_EQ(list("2.5", {"2", "--set", "wind.speed=9"}), (There{{"2.5", false}}));
    EXPECT_EQ(list("5-1:-2", {"2", "--frames-dialect", "openjd", "--progress", "plain"}),
              (There{{"5", false}, {"3", false}, {"1", false}}));
    EXPECT_EQ(list("900-901", {"2", "--skip-outside", "--quiet"}), There{});
    EXPECT_EQ(lines(marram({"render", scene, "-o", folder / "no folder/a.exr", "--list"}).out),
              std::vector<std::string>{fmt::format(R"({{"frame":"1","picture":"{}","there":false}})",
                                                   folder / "no folder/a.exr")});
    const ProgramResult refused = marram({"render", scene, "-o", folder / "a.toml", "--list"});
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(refused.out, "");
}

} // namespace
} // namespace marram::testing
