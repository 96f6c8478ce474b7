// SPDX-License-Identifier: Apache-2.0
// What the program does when something runs out: the disk, memory, the length of a name. A sequence takes no
// more memory than its first frames.
#include "core/shot/stats.h"
#include "program.h"

#include <nlohmann/json.hpp>

#include <sys/resource.h>

#include <array>
#include <csignal>

namespace marram::testing {
namespace {

rlimit limit_of(int resource, rlim_t bytes) {
    rlimit limit{};
    ::getrlimit(resource, &limit);
    limit.rlim_cur = bytes;
    return limit;
}

// Runs the program with one limit: RLIMIT_FSIZE or RLIMIT_AS.
template <int resource>
ProgramResult limited(const std::vector<std::string>& arguments, size_t bytes) {
    static size_t limit = 0;
    limit = bytes;
    return marram(arguments, [](std::vector<std::string> given) {
        const rlimit set = limit_of(resource, limit), none = limit_of(RLIMIT_CORE, 0);
        ::setrlimit(RLIMIT_CORE, &none);
        ::setrlimit(resource, &set);
        run_program(std::move(given));
    });
}

nlohmann::json json_of(const std::string& file) { return nlohmann::json::parse(read_file(file)); }

TEST(Limits, AFullDiskIsReportedAndTheOldPictureStays) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    for (const std::string extension : {".exr", ".png"}) {
        const std::string picture = folder / ("a" + extension), old = "an old picture";
        folder.write("a" + extension, old);
        const std::vector<std::string> command = {"render", scene, "-o", picture, "--quiet"};
        const ProgramResult full = limited<RLIMIT_FSIZE>(command, 300);
        EXPECT_EQ(full.code, 2);
        EXPECT_EQ(full.out, "");
        EXPECT_CONTAINS(full.err, picture + ": could not be written (File too large): check the disk");
        EXPECT_EQ(read_file(picture), old);
        EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", "a" + extension}));
        fs::remove(picture);
    }
}

// The state of an earlier run is kept if the picture cannot be saved.
TEST(Limits, WhatCannotBeSavedIsKeptForResume) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText()), picture = folder / "a.exr";
    const std::string reference = folder / "b.exr", state = folder / "a.exr.state.tif";
    const auto render = [&](const std::string& file, std::vector<std::string> more) {
        std::vector<std::string> command = {"render", scene, "-o", file, "--quiet", "--spp", "400"};
        command.insert(command.end(), more.begin(), more.end());
        return command;
    };
    ASSERT_EQ(marram(render(reference, {})).code, 0);
    ASSERT_EQ(marram(render(picture, {"--seconds", "0.001"})).code, 0);
    ASSERT_TRUE(fs::exists(state));
    const std::string before = read_file(state);
    EXPECT_EQ(limited<RLIMIT_FSIZE>(render(picture, {"--resume"}), 300).code, 2);
    EXPECT_TRUE(read_file(state) == before) << "the state that could resume stays";
    ASSERT_EQ(marram(render(picture, {"--resume"})).code, 0);
    EXPECT_TRUE(same_picture(picture, reference));
    EXPECT_FALSE(fs::exists(state));
}

TEST(Limits, StandardOutputMayBeFull) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    const ProgramResult outcome =
        marram({"render", scene, "-o", folder / "a.exr"}, [](std::vector<std::string> given) {
            ::dup2(::open("/dev/full", O_WRONLY), STDOUT_FILENO);
            run_program(std::move(given));
        });
    EXPECT_EQ(outcome.code, 2);
    EXPECT_CONTAINS(outcome.err, "standard output: could not be written");
    EXPECT_TRUE(fs::exists(folder / "a.exr"));
}

// Warnings that nobody can read are no reason to lose what was made, nor is a result: the run goes on to its
// end.
TEST(Limits, StandardErrorMayBeFull) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [24, 16]\nsamples = 2\nmax_depth = 3\naovs = [\"depth\"]\n"});
    static int streams[2];
    const auto full = [](std::vector<std::string> given) {
        for (const int stream : streams) ::dup2(::open("/dev/full", O_WRONLY), stream);
        run_copy(std::move(given));
    };
    const std::vector<std::string> command = {"render",   scene, "-o", folder / "a.####.png",
                                              "--frames", "1-2"};
    streams[0] = streams[1] = STDERR_FILENO;
    EXPECT_EQ(marram(command, full).code, 0);
    const std::set<std::string> names = {"a.0001.png", "a.0002.png", "a.toml"};
    EXPECT_EQ(folder.names(), names);
    for (const std::string& name : names)
        if (name != "a.toml") fs::remove(folder / name);
    streams[0] = STDOUT_FILENO;
    EXPECT_EQ(marram(command, full).code, 2) << "the names were asked for";
    EXPECT_EQ(folder.names(), names);
}

// Statistics that cannot be written end no sequence: its end reports them.
TEST(Limits, StatisticsAreReportedAtTheEnd) {
    const Folder folder;
    for (const char* name : {"gone/a.####.json", "gone/a.json"}) {
        StatsFile file(folder / name);
        EXPECT_NO_THROW(file.add({}));
        EXPECT_THROW(file.finish(), InputError);
    }
}

// The reader of a pipe may leave, as `head` does: the frames are rendered, then the process ends as others
// do.
TEST(Limits, TheReaderOfAPipeMayLeave) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    const auto broken = [](std::vector<std::string> given) {
        int ends[2];
        if (::pipe(ends) != 0) ::_exit(99);
        ::close(ends[0]);
        ::dup2(ends[1], STDOUT_FILENO);
        ::dup2(ends[1], STDERR_FILENO);
        run_copy(std::move(given));
    };
    EXPECT_EQ(marram({"render", scene, "-o", folder / "a.####.png", "--frames", "1-2"}, broken).code,
              128 + SIGPIPE);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.0001.png", "a.0002.png", "a.toml"}));
}

// With the descriptors closed no file of the program gets their numbers, and no warning ends up in it.
TEST(Limits, ClosedStreamsWriteIntoNoFile) {
    const Folder folder;
    // Warns while the file of all frames is open.
    const std::string scene =
        folder.write("a.toml", SceneText{.globals = "frames = [1, 2]\ntolerance = 1e-9\n",
                                         .groom = "count = 2\ncvs = 0\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    const auto closed = [](std::vector<std::string> given) {
        for (const int stream : {STDIN_FILENO, STDERR_FILENO}) ::close(stream);
        run_program(std::move(given));
    };
    EXPECT_EQ(marram({"bake", scene, "-o", folder / "a.usda", "--frames", "1-2"}, closed).code, 0);
    const ProgramResult open = marram({"bake", scene, "-o", folder / "b.usda", "--frames", "1-2"}, run_copy);
    EXPECT_EQ(open.code, 0);
    EXPECT_CONTAINS(open.err, "the tolerance is not reached");
    EXPECT_TRUE(read_file(folder / "a.usda") == read_file(folder / "b.usda"));
}

// A scene with a mistake a line is answered by the first ones and their number.
TEST(Limits, ManyMistakesAreCounted) {
    const Folder folder;
    std::string text = SceneText();
    for (int i = 0; i < 300; ++i) text += fmt::format("unknown{} = 1\n", i);
    const ProgramResult refused =
        marram({"render", folder.write("a.toml", text), "-o", folder / "a.png"}, run_copy);
    EXPECT_EQ(refused.code, 2);
    ASSERT_EQ(lines(refused.err).size(), 51U);
    EXPECT_EQ(lines(refused.err).back(), "marram: 250 more mistakes: correct those above first");
}

#ifndef __SANITIZE_ADDRESS__ // it reserves terabytes of addresses

// A small stack is enlarged where that is allowed, otherwise it is one line.
TEST(Limits, ASmallStackIsOneLine) {
    const auto with_stack = [](bool hard) {
        static rlim_t most = 0;
        most = hard ? 64 << 10 : RLIM_INFINITY;
        return marram({"info", "fps"}, [](std::vector<std::string> given) {
            rlimit limit{};
            ::getrlimit(RLIMIT_STACK, &limit);
            limit.rlim_cur = 64 << 10;
            limit.rlim_max = std::min(limit.rlim_max, most);
            ::setrlimit(RLIMIT_STACK, &limit);
            run_program(std::move(given));
        });
    };
    const ProgramResult enlarged = with_stack(false), refused = with_stack(true);
    EXPECT_EQ(enlarged.code, 0) << enlarged.err;
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(lines(refused.err).size(), 1U);
    EXPECT_CONTAINS(refused.err, "the stack is limited to less than 1 MiB");
}

// From where the loader succeeds, in steps of 6 MiB: the result is a picture, or exit code 2 and one line
// about memory.
TEST(Limits, LittleMemoryIsOneLine) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText()), picture = folder / "a.exr";
    int loader = 0, refused = 0, done = 0;
    for (size_t mega = 300; mega < 1500 && done < 3; mega += 12) {
        const ProgramResult outcome =
            limited<RLIMIT_AS>({"render", scene, "-o", picture, "--quiet"}, mega << 20);
        if (outcome.code == 127) { // a shared library did not fit
            ++loader;
            continue;
        }
        EXPECT_TRUE(outcome.code == 0 || outcome.code == 2) << mega << ": " << outcome.code << outcome.err;
        done += outcome.code == 0;
        if (outcome.code == 0) continue;
        ++refused;
        EXPECT_EQ(lines(outcome.err).size(), 1U) << mega << ": " << outcome.err;
        EXPECT_CONTAINS(outcome.err, "memory");
        EXPECT_FALSE(fs::exists(picture));
    }
    std::printf("%d limits too small for the loader, %d refused, %d done\n", loader, refused, done);
    EXPECT_GT(refused, 5);
    EXPECT_EQ(done, 3);
}

// The full test for every scene: tests/bench/memory.
TEST(Limits, ASequenceTakesNoMoreMemoryThanItsFirstFrames) {
    const auto peak = [](const char* frames) {
        const Folder folder;
        const ProgramResult outcome = marram({"render", MARRAM_SOURCE_DIR "/scenes/golden/sheet.toml", "-o",
                                              folder / "a.####.exr", "--frames", frames, "--size", "32x18",
                                              "--spp", "1", "--quiet", "--stats", folder / "s.json"});
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        return json_of(folder / "s.json").back()["memory"]["peak_bytes"].get<double>();
    };
    const double few = peak("1-20"), many = peak("1-300");
    std::printf("peak after 20 frames %.1f MiB, after 300 %.1f MiB\n", few / 0x1p20, many / 0x1p20);
    EXPECT_LT(many, 1.02 * few);
}

#endif

TEST(Limits, NamesMayBeLong) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    EXPECT_EQ(marram({"render", scene, "-o", folder / (std::string(240, 'n') + ".exr"), "--quiet"}).code, 0);
    const ProgramResult outcome = marram({"render", scene, "-o", folder / (std::string(250, 'n') + ".exr")});
    EXPECT_EQ(outcome.code, 2);
    EXPECT_CONTAINS(outcome.err, "the limit is 255: give it a shorter name");
    const std::string text(6000, 'x');
    for (const std::vector<std::string>& command : {std::vector<std::string>{"render", text},
                                                    {"render", scene, "--size", text},
                                                    {"render", scene, "--" + text},
                                                    {"render", scene, "--set", text},
                                                    {"compare", text, text},
                                                    {"info", text}}) {
        const ProgramResult refused = marram(command);
        EXPECT_EQ(refused.code, 2);
        EXPECT_LT(refused.err.size(), 2000U) << command[0];
    }
}

TEST(Limits, StatsOfASequenceHaveAFileAFrame) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    EXPECT_DONE(marram(
        {"render", scene, "-o", folder / "a.##.exr", "--frames", "2-3", "--stats", folder / "s.##.json"}));
    EXPECT_EQ(json_of(folder / "s.02.json")["frame"], 2.0);
    EXPECT_EQ(json_of(folder / "s.03.json")["frame"], 3.0);
    EXPECT_FALSE(fs::exists(folder / "s.##.json"));
}

// Warns about settings that are allowed but probably not intended.
TEST(Limits, WhatNobodyWillSeeIsSaid) {
    const Folder folder;
    SceneText text;
    text.groom = "count = 10\nlength = 0.3\nwidth = 0\n";
    ProgramResult outcome = marram({"render", folder.write("a.toml", text), "-o", folder / "a.exr"});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_CONTAINS(outcome.err, "width is 0, no strand will be seen");

    text = {};
    text.more = "[[material]]\nname = \"white\"\ntype = \"diffuse\"\ncolor = 1\n[[mesh]]\nname = \"box\"\n"
                "type = \"box\"\nsize = [9, 9, 9]\nmaterial = \"white\"\n";
    const std::string scene = folder.write("white.toml", text);
    outcome = marram({"render", scene, "-o", folder / "a.exr"});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_CONTAINS(outcome.err, "film.max_depth = 3 ends paths that carry up to");

    outcome = marram({"render", folder.write("far.toml", SceneText()), "-o", folder / "a.exr", "--set",
                      "mesh.ground.transform.translate=[1e6, 0, 0]"});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_CONTAINS(outcome.err, "m from the origin are rounded to");

    outcome = marram({"bake", folder.write("long.toml", SceneText()), "-o", folder / "a.hair", "--set",
                      "procedural.grass.length=[0.3, 1e6]"});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_CONTAINS(outcome.err, "m long on a mesh of");
}

// Warns about settings that change nothing, and about those that leave no strands.
TEST(Limits, WhatChangesNothingIsTold) {
    const Folder folder;
    write_png(folder / "black.png", 1, 1, 3, std::array{0.0F, 0.0F, 0.0F}.data(), 0.0);
    const auto said = [&](const std::string& more) {
        const std::string scene =
            folder.write("a.toml", SceneText{.groom = "length = 0.1\nwidth = 0.01\n" + more});
        const ProgramResult outcome = marram({"bake", scene, "-o", folder / "a.hair"});
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        return outcome.err;
    };
    const std::string black = "[{ image = \"black.png\" }]\n";
    EXPECT_CONTAINS(said("count = 9\ncurl_by = " + black),
                    "curl_by changes nothing: curl.radius is 0: leave it out");
    EXPECT_CONTAINS(said("count = 9\nclump_by = " + black), "clump_by changes nothing: clump.size is 0");
    EXPECT_CONTAINS(said("count = 9\nfrizz_by = " + black), "frizz_by changes nothing: frizz.amplitude is 0");
    EXPECT_CONTAINS(said("density = 100\ndensity_by = " + black), "no strands");
    EXPECT_CONTAINS(said("density = 0\n"), "no strands");
}

// A strand whose swing hardly decays takes hours: this is announced before the work begins.
TEST(Limits, LongWorkIsAnnounced) {
    const Folder folder;
    SceneText text;
    text.wind = "speed = 6\nglobal_rotate = 1\nnoise = { amplitude = 0.5, frequency = 2 }\n"
                "jiggle = { frequency = 2, damping = 0.001 }\n";
    text.groom = "count = 20000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.002\n";
    const std::string scene = folder.write("a.toml", text);
    EXPECT_EQ(interrupt_in("s of one processor for a frame alone", {"render", scene, "-o", folder / "a.exr"}),
              130);
    EXPECT_EQ(folder.names(), std::set<std::string>{"a.toml"});
}

TEST(Limits, LongWorkOnStrandsOfAFileIsAnnounced) {
    const Folder folder;
    std::string points, line = "l";
    constexpr int cvs = 8000;
    for (int k = 0; k < cvs; ++k) {
        points += "v 0 " + std::to_string(k * 1e-4) + " 0\n";
        line += " " + std::to_string(k + 1);
    }
    folder.write("one.obj", points + line + "\n");
    SceneText text;
    text.wind = "speed = 6\nglobal_rotate = 1\nnoise = { amplitude = 0.5, frequency = 2 }\n"
                "jiggle = { frequency = 2, damping = 0.001 }\n";
    text.more = "[[curves]]\ntype = \"strands\"\nname = \"one\"\nfile = \"one.obj\"\n"
                "[[procedural]]\ntype = \"strands\"\nname = \"hair\"\ncurves = \"one\"\nwidth = 0.01\n";
    const std::string scene = folder.write("a.toml", text);
    EXPECT_EQ(interrupt_in("CVs, 8000 per strand", {"render", scene, "-o", folder / "a.exr"}), 130);
}

// Stays within 0 and 1, however far segments are pushed out and however near their goal was.
TEST(Limits, TheShareOfTheWayIsAShare) {
    const Folder folder;
    SceneText text;
    text.groom += "clear_of = \"none\"\n";
    text.wind = "speed = 6\nglobal_rotate = 0.01\ncollision = { solver = \"exact\" }\n";
    text.more = "[[mesh]]\nname = \"stone\"\ntype = \"sphere\"\nradius = 0.9\ndivisions = 8\n";
    const ProgramResult outcome = marram(
        {"render", folder.write("a.toml", text), "-o", folder / "a.exr", "--stats", folder / "s.json"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json collision = json_of(folder / "s.json")["collision"];
    EXPECT_GT(collision["pushed_out"], 20);
    EXPECT_GE(collision["reached"], 0.0);
    EXPECT_LE(collision["reached"], 1.0);
    std::printf("reached %g\n", collision["reached"].get<double>());
}

} // namespace
} // namespace marram::testing
