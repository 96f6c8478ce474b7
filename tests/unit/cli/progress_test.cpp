// SPDX-License-Identifier: Apache-2.0
// --progress: when lines are due, by a clock that the test moves, and what programs read on stdout.
#include "core/cli/progress.h"
#include "program.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <random>

namespace marram::testing {
namespace {

const SceneText few_frames = {.film = "size = [8, 6]\nsamples = 2\n"};

TEST(Progress, IsDueWhenThePercentageChangesAtMostOnceASecond) {
    ProgressText text(ProgressStyle::plain, 0.1);
    text.begin_part(0.0, 1.0);
    const auto tracing = [&](double seconds, double fraction) {
        return text.due_lines(seconds, {"rendering", fraction, true});
    };
    EXPECT_EQ(tracing(0.0, 0.0), "10%\n") << "the build's share";
    EXPECT_EQ(tracing(0.5, 0.5), "") << "too soon";
    EXPECT_EQ(tracing(1.0, 0.5), "55%\n");
    EXPECT_EQ(tracing(2.0, 0.501), "") << "the same percentage";
    EXPECT_EQ(tracing(8.5, 0.501), "");
    EXPECT_EQ(tracing(9.0, 0.501), "55%\n") << "after 8 s in any case";
    EXPECT_EQ(tracing(10.0, 1.0), "99%\n") << "not 100 before the file is closed";
    EXPECT_EQ(tracing(18.0, 1.0), "99%\n");
    EXPECT_EQ(text.done(), "100%\n");
}

TEST(Progress, NamesNewPhases) {
    ProgressText text(ProgressStyle::openjd, 0.1);
    text.begin_part(0.0, 0.5);
    EXPECT_EQ(text.due_lines(0.0, {"loading", 0.0}), "openjd_status: loading\nopenjd_progress: 0.0\n");
    EXPECT_EQ(text.due_lines(0.9, {"simulating", 0.0}), "");
    EXPECT_EQ(text.due_lines(1.0, {"simulating", 0.0}), "openjd_status: simulating\nopenjd_progress: 2.5\n");
    EXPECT_EQ(text.due_lines(9.0, {"simulating", 0.0}), "openjd_progress: 2.5\n") << "a sign of life";
    EXPECT_EQ(text.due_lines(10.0, {"rendering", 0.0, true}),
              "openjd_status: rendering\nopenjd_progress: 5.0\n");
    EXPECT_EQ(text.due_lines(11.0, {"rendering", 0.5, true}), "openjd_progress: 27.5\n");
    EXPECT_EQ(text.stopped("interrupted by SIGTERM"), "openjd_status: interrupted by SIGTERM\n");
    EXPECT_EQ(text.done(), "openjd_status: done\nopenjd_progress: 100.0\n");
}

TEST(Progress, NeverGoesBackwards) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> any(-0.1, 1.1);
    for (int run = 0; run < 50; ++run) {
        ProgressText text(ProgressStyle::alf, 0.1);
        int last = 0;
        double seconds = 0.0;
        for (int part = 0; part < 5; ++part) {
            text.begin_part(part / 5.0, (part + 1) / 5.0);
            for (int i = 0; i < 20; ++i) {
                const std::string line = text.due_lines(
                    seconds += 2.0, {std::to_string(random() % 3), any(random), random() % 2 == 0});
                if (line.empty()) continue;
                int percent = -1;
                ASSERT_EQ(std::sscanf(line.c_str(), "ALF_PROGRESS %d%%\n", &percent), 1) << line;
                EXPECT_GE(percent, std::max(last, part * 20));
                EXPECT_LT(percent, 100);
                EXPECT_LE(percent, (part + 1) * 20);
                last = percent;
            }
        }
    }
}

// The lines of a render of two frames. The last is 100 %, after the names of both pictures.
std::vector<std::string> lines_of(const std::string& style, const std::string& command = "render",
                                  const std::string& output = "f.#.exr") {
    const Folder folder;
    const std::string scene = folder.write("a.toml", few_frames);
    const ProgramResult done =
        marram({command, scene, "-o", folder / output, "--frames", "1-2", "--progress", style});
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.err, "");
    std::vector<std::string> all = lines(done.out), pictures;
    std::ranges::copy_if(all, std::back_inserter(pictures),
                         [&](const auto& line) { return line.starts_with(folder / "f."); });
    EXPECT_EQ(pictures.size(), 2u) << done.out;
    EXPECT_EQ(all.size() > 2, !all.back().starts_with(folder / "f.")) << "progress ends after the files";
    std::erase_if(all, [&](const auto& line) { return line.starts_with(folder / "f."); });
    return all;
}

TEST(Progress, IsReadByFarms) {
    for (const auto& [style, first, last] : std::vector<std::array<std::string, 3>>{
             {"plain", "0%", "100%"}, {"alf", "ALF_PROGRESS 0%", "ALF_PROGRESS 100%"}}) {
        const std::vector<std::string> all = lines_of(style);
        ASSERT_GE(all.size(), 2u);
        EXPECT_EQ(all.front(), first);
        EXPECT_EQ(all.back(), last);
        EXPECT_EQ(std::ranges::count(all, last), 1);
    }
    const std::vector<std::string> openjd = lines_of("openjd");
    EXPECT_TRUE(openjd.front().starts_with("openjd_status: "));
    EXPECT_EQ(openjd.back(), "openjd_progress: 100.0");
    for (const std::string& line : openjd)
        EXPECT_TRUE(line.starts_with("openjd_status: ") || line.starts_with("openjd_progress: ")) << line;
    double last = 0.0;
    for (const std::string& line : lines_of("json")) {
        const nlohmann::json object = nlohmann::json::parse(line);
        EXPECT_GE(object.at("progress").get<double>(), last);
        last = object.at("progress").get<double>();
        EXPECT_TRUE(object.at("status").is_string());
        EXPECT_EQ(object.at("time").get<std::string>().size(), std::strlen("2026-11-30T15:56:58.123Z"));
    }
    EXPECT_EQ(last, 100.0);
    EXPECT_TRUE(lines_of("none").empty());
    EXPECT_TRUE(lines_of("auto").empty()) << "stderr is a pipe, and stdout holds names alone";
}

TEST(Progress, OfABakeIsTheSame) {
    EXPECT_EQ(lines_of("plain", "bake", "f.#.hair").back(), "100%");
    EXPECT_EQ(lines_of("openjd", "bake", "f.#.obj").back(), "openjd_progress: 100.0");
}

// --quiet silences what nobody has asked for.
TEST(Progress, IsPrintedWhereItWasAskedFor) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", few_frames);
    const ProgramResult done =
        marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--progress=plain"});
    EXPECT_CONTAINS(done.out, "100%\n");
}

TEST(Progress, SaysWhyARunHasFailed) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", std::string(few_frames) + "[films]\n");
    const ProgramResult done = marram({"render", scene, "-o", folder / "a.exr", "--progress", "openjd"});
    EXPECT_EQ(done.code, 2);
    const std::vector<std::string> all = lines(done.out);
    ASSERT_FALSE(all.empty());
    EXPECT_EQ(all.back(), "openjd_fail: " + lines(done.err).front());
    EXPECT_EQ(done.out.find("100"), std::string::npos);
    const ProgramResult unknown = marram({"render", scene, "--progress", "openjd", "--unknown"});
    EXPECT_EQ(unknown.code, 2);
    EXPECT_TRUE(unknown.out.starts_with("openjd_fail: marram: ")) << unknown.out;
    const ProgramResult other = marram({"render", scene, "--progress", "percent"});
    EXPECT_EQ(other.code, 2);
    EXPECT_EQ(other.out, "");
    EXPECT_CONTAINS(other.err, "percent not in {auto,plain,openjd,alf,json,none}");
}

TEST(Progress, OfAnInterruptedRunIsNotWhole) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.film = "size = [256, 256]\nsamples = 65536\n"});
    const std::string out = folder / "out";
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
        run_program({"render", scene, "-o", folder / "a.exr", "--progress", "openjd"});
    }
    while (read_file(out).find("rendering") == std::string::npos && ::waitpid(child, nullptr, WNOHANG) == 0)
        ::usleep(20'000); // the line is there at once although stdout is a file
    ::kill(child, SIGTERM);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(exit_code(status), 143);
    const std::vector<std::string> all = lines(read_file(out));
    EXPECT_EQ(all.back(), "openjd_status: interrupted by SIGTERM");
    EXPECT_EQ(all[all.size() - 2], folder / "a.partial.exr");
    EXPECT_EQ(read_file(out).find("openjd_fail"), std::string::npos);
}

// A log that is silent for long is taken for a dead job: a procedural that hangs is no reason for silence.
TEST(Progress, GivesSignsOfLifeWhileAFrameIsBuilt) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[[procedural]]\nname = \"stuck\"\n"
                  "type = \"faulty_curves\"\nfault = \"stuck\"\nlibrary = \"" MARRAM_BINARY_DIR
                  "/libfaulty_plugin.so\"\n");
    const std::string out = folder / "out";
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
        run_program({"render", scene, "-o", folder / "a.exr", "--progress", "plain"});
    }
    while (lines(read_file(out)).size() < 3 && ::waitpid(child, nullptr, WNOHANG) == 0) ::usleep(50'000);
    ::kill(child, SIGTERM);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(exit_code(status), 143);
    for (const std::string& line : lines(read_file(out))) EXPECT_TRUE(line.ends_with("%")) << line;
}

} // namespace
} // namespace marram::testing
