// SPDX-License-Identifier: Apache-2.0
// Interrupted frames continue bit for bit. A frame to be stopped has more samples than it can ever take;
// where it stopped is read from its picture, and it continues to a few samples more. So neither being stopped
// nor passing depends on the clock.
#include "core/shot/checkpoint.h"
#include "program.h"

#include <nlohmann/json.hpp>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <random>

namespace marram::testing {
namespace {

const std::string endless = "65536"; // samples
const SceneText grassy{.film =
                           "size = [40, 24]\nsamples = 8\nmax_depth = 3\naovs = [\"variance\", \"depth\"]\n",
                       .groom = "count = 2000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"};
const std::string layers = "albedo,normal,strand_u,id,envelope";

int samples_of(const std::string& path) {
    return std::stoi(read_metadata(path, "marram:samples").value_or("0"));
}

uint64_t rays_of(const std::string& path) {
    return nlohmann::json::parse(read_file(path))["rays"].get<uint64_t>();
}

class Resume : public ::testing::Test {
  protected:
    // The command that renders this picture.
    std::vector<std::string> command(const std::string& picture,
                                     const std::vector<std::string>& more = {}) const {
        std::vector<std::string> all = {"render", scene, "-o", folder / picture, "--aov", layers};
        all.insert(all.end(), settings.begin(), settings.end());
        all.insert(all.end(), more.begin(), more.end());
        return all;
    }
    std::vector<std::string> with_samples(const std::string& picture, int samples,
                                          std::vector<std::string> more = {}) const {
        more.insert(more.end(), {"--spp", std::to_string(samples)});
        return command(picture, more);
    }
    // Renders a frame that a time limit stops, after at least one pass. Returns its samples.
    int stop_by_time(const std::string& seconds = "0.001") const {
        const ProgramResult done =
            marram(command("a.exr", {"--seconds", seconds, "--spp", endless, "--resume", "--quiet"}));
        EXPECT_EQ(done.code, 0) << done.err;
        EXPECT_CONTAINS(done.err, "time was up after ");
        EXPECT_TRUE(fs::exists(state));
        return samples_of(folder / "a.exr");
    }
    void interrupt(int redraws, int signal = SIGINT) const {
        EXPECT_EQ(
            interrupt_in("rendering", command("a.exr", {"--spp", endless, "--resume"}), signal, redraws),
            128 + signal);
        EXPECT_TRUE(fs::exists(state));
    }
    void expect_goes_on_to(int samples) const {
        const ProgramResult done = marram(with_samples("a.exr", samples, {"--resume"}));
        EXPECT_EQ(done.code, 0) << done.err;
        EXPECT_CONTAINS(done.err, "resumed at ");
        expect_uninterrupted_result(samples);
    }
    // The finished picture equals that of an uninterrupted run, and no other file is left.
    void expect_uninterrupted_result(int samples) const {
        EXPECT_DONE(marram(with_samples("one.exr", samples)));
        EXPECT_TRUE(same_picture(folder / "a.exr", folder / "one.exr"));
        for (const char* key : {"marram:samples", "marram:mean_samples", "marram:digest"})
            EXPECT_EQ(read_metadata(folder / "a.exr", key), read_metadata(folder / "one.exr", key)) << key;
        EXPECT_FALSE(fs::exists(state));
        EXPECT_FALSE(fs::exists(folder / "a.partial.exr"));
    }

    Folder folder;
    std::string scene = folder.write("a.toml", grassy);
    std::string state = folder / "a.exr.state.tif";
    std::vector<std::string> settings;
};

TEST_F(Resume, GoesOnWhereItWasInterruptedAgainAndAgain) {
    interrupt(1);
    interrupt(3, SIGTERM);
    interrupt(6);
    expect_goes_on_to(samples_of(folder / "a.partial.exr") + 23);
}

// By then pixels of the sky have been done for a while; others stop and start again.
TEST_F(Resume, KnowsWhichPixelsWereDone) {
    settings = {"--set", "film.noise=0.004"};
    interrupt(2);
    interrupt(4);
    const std::string partial = folder / "a.partial.exr";
    EXPECT_LT(std::stod(read_metadata(partial, "marram:mean_samples").value_or("inf")), samples_of(partial));
    expect_goes_on_to(samples_of(partial) + 23);
}

TEST_F(Resume, GoesOnWhenTimeWasUp) {
    stop_by_time();
    const int samples = stop_by_time("0.1");
    EXPECT_FALSE(fs::exists(folder / "a.partial.exr"));
    expect_goes_on_to(samples + 23);
}

// A state is many times as large as its picture. If there is no room for it, the picture is still written.
TEST_F(Resume, AStateThatCannotBeWrittenTakesNoPictureWithIt) {
    constexpr rlim_t room = 4 << 20; // bytes a file
    const auto in_little_room = [](std::vector<std::string> arguments) {
        const rlimit limit{room, room};
        ::setrlimit(RLIMIT_FSIZE, &limit);
        ::signal(SIGXFSZ, SIG_IGN); // a write fails, as on a full disk
        run_program(std::move(arguments));
    };
    const ProgramResult done = marram(
        command("a.exr", {"--seconds", "0.001", "--spp", endless, "--size", "256x192"}), in_little_room);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_CONTAINS(done.err, "--resume will start this frame again");
    EXPECT_CONTAINS(done.err, state);
    EXPECT_EQ(done.out, folder / "a.exr" + "\n");
    EXPECT_EQ(read_image(folder / "a.exr").width, 256);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.toml"}));
}

// No sample is taken twice: both halves together trace as many rays as the whole.
TEST_F(Resume, TakesNoSampleTwice) {
    const auto with_stats = [&](std::vector<std::string> all, const std::string& name) {
        all.insert(all.end(), {"--stats", folder / name});
        EXPECT_EQ(marram(all).code, 0);
        return rays_of(folder / name);
    };
    const uint64_t first =
        with_stats(command("a.exr", {"--seconds", "0.02", "--spp", endless, "--quiet"}), "a.json");
    const int samples = samples_of(folder / "a.exr") + 5;
    const uint64_t second = with_stats(with_samples("a.exr", samples, {"--resume", "--quiet"}), "b.json");
    EXPECT_EQ(first + second, with_stats(with_samples("one.exr", samples), "one.json"));
}

TEST_F(Resume, GoesOnFromTheStateEvenWhereThePictureIsGone) {
    const int samples = stop_by_time();
    fs::remove(folder / "a.exr");
    expect_goes_on_to(samples + 3);
}

// Without --resume existing states are ignored.
TEST_F(Resume, BeginsAnewWhereNobodyAskedForMore) {
    const int samples = stop_by_time();
    EXPECT_DONE(marram(with_samples("a.exr", samples + 3)));
    expect_uninterrupted_result(samples + 3);
}

TEST_F(Resume, OtherFramesAreOtherStates) {
    const ProgramResult stopped =
        marram(command("f.#.exr", {"--frames", "1-2", "--spp", endless, "--seconds", "0.001", "--quiet"}));
    EXPECT_EQ(stopped.code, 0) << stopped.err;
    fs::copy_file(folder / "f.1.exr.state.tif", state);
    const int samples = samples_of(folder / "f.1.exr") + 3;
    const ProgramResult other = marram(with_samples("a.exr", samples, {"--frame", "2", "--resume"}));
    EXPECT_EQ(other.code, 0);
    EXPECT_CONTAINS(other.err, "belongs to another scene, size, layer list, frame or program version: the "
                               "frame is rendered from the start");
    fs::remove(folder / "f.2.exr.state.tif");
    EXPECT_EQ(marram(with_samples("f.#.exr", samples, {"--frames", "1-2", "--resume", "--quiet"})).code, 0);
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "f.2.exr"));
    EXPECT_FALSE(same_picture(folder / "a.exr", folder / "f.1.exr"));
}

// Each of these prints one line with the reason and renders the frame from its first sample.
TEST_F(Resume, AStateThatDoesNotFitIsNotUsed) {
    const int samples = stop_by_time() + 3;
    const std::string good = read_file(state);
    std::string bit = good;
    bit[bit.size() / 2] ^= 1;
    std::string last = good; // of the last pixel's last word
    last.back() ^= 1;
    const std::map<std::string, std::string> damaged = {{"a bit", bit},
                                                        {"the last byte", last},
                                                        {"half", good.substr(0, good.size() / 2)},
                                                        {"its end", good.substr(0, good.size() - 64)},
                                                        {"empty", ""}};
    for (const auto& [what, bytes] : damaged) {
        folder.write("a.exr.state.tif", bytes);
        const ProgramResult done = marram(with_samples("a.exr", samples, {"--resume"}));
        EXPECT_EQ(done.code, 0) << what;
        EXPECT_EQ(done.err, state + ": is damaged or cut short: the frame is rendered from the start\n")
            << what;
        expect_uninterrupted_result(samples);
        fs::remove(folder / "a.exr"); // otherwise the next run would find it complete
    }
    folder.write("a.exr.state.tif", good); // the content decides, not the file
    expect_goes_on_to(samples);
}

TEST_F(Resume, AStateOfAnotherFrameIsNotUsed) {
    const int samples = stop_by_time() + 3;
    const std::string good = read_file(state);
    for (const std::vector<std::string>& other : std::vector<std::vector<std::string>>{
             {"--set", "wind.speed=3"}, {"--size", "24x40"}, {"--frame", "2"}, {"--set", "film.noise=0.1"}}) {
        folder.write("a.exr.state.tif", good);
        settings = other;
        const ProgramResult done = marram(with_samples("a.exr", samples, {"--resume"}));
        EXPECT_EQ(done.code, 0) << other[1];
        EXPECT_EQ(done.err,
                  state +
                      ": belongs to another scene, size, layer list, frame or program version: the frame is "
                      "rendered from the start\n");
        expect_uninterrupted_result(samples);
    }
    settings.clear();
    folder.write("a.exr.state.tif", good);
    folder.write("a.toml", std::string(grassy) + "# another file\n");
    EXPECT_CONTAINS(marram(with_samples("a.exr", samples, {"--resume"})).err, "another scene");
}

TEST_F(Resume, AStateOfMoreSamplesIsNotUsed) {
    const int samples = stop_by_time();
    ASSERT_GE(samples, 1);
    const int more = stop_by_time("0.05");
    ASSERT_GT(more, samples);
    const ProgramResult done = marram(with_samples("a.exr", more - 1, {"--resume"}));
    EXPECT_EQ(
        done.err,
        fmt::format(
            "{}: has {} samples a pixel, more than the {} asked for: the frame is rendered from the start\n",
            state, more, more - 1));
    expect_uninterrupted_result(more - 1);
}

// A file with the state's name that is no state belongs to the user: nothing is written.
TEST_F(Resume, SomebodysPictureIsLeftAlone) {
    EXPECT_DONE(marram(with_samples("b.exr", 1)));
    fs::copy_file(folder / "b.exr", state);
    for (const char* text : {"", "a letter to somebody"}) {
        if (*text) folder.write("a.exr.state.tif", text);
        const auto before = folder.contents();
        const ProgramResult done = marram(with_samples("a.exr", 1));
        EXPECT_EQ(done.code, 2);
        EXPECT_CONTAINS(done.err,
                        state + ": this file would be overwritten by the state of an unfinished frame");
        EXPECT_TRUE(folder.contents() == before);
    }
}

// By a clock that the test moves: the saved state never gets older than asked for while passes take as long
// as the one before, and saving takes half of the time at most.
TEST(CheckpointTimes, KeepTheStateYoung) {
    double now = 100.0, cost = 0.0;
    int saves = 0;
    Checkpoint checkpoint(
        10.0, [&] { ++saves, now += cost; }, [&] { return now; });
    const auto saves_after = [&](double pass) {
        now += pass;
        checkpoint.save_if_due();
        return saves;
    };
    EXPECT_EQ(saves_after(3.0), 0);
    EXPECT_EQ(saves_after(3.0), 0);
    EXPECT_EQ(saves_after(3.0), 1) << "9 s old, and 12 s after another pass";
    cost = 8.0;
    EXPECT_EQ(saves_after(4.0), 1);
    EXPECT_EQ(saves_after(4.0), 2);
    EXPECT_EQ(saves_after(1.0), 2) << "9 s old, but the save has taken 8 s";
    EXPECT_EQ(saves_after(6.0), 3);
    Checkpoint never(0.0, [] { FAIL(); });
    never.save_if_due();
    Checkpoint failing(
        1.0, []() { throw InputError({"a.tif"}, "cannot be written", "look why"); }, [&] { return now; });
    failing.save_if_due();
    EXPECT_FALSE(failing.take_fault());
    now += 1.0;
    failing.save_if_due();
    EXPECT_EQ(to_string(failing.take_fault().value()), "a.tif: cannot be written: look why");
    EXPECT_FALSE(failing.take_fault());
}

// --checkpoint: kill -9 at any moment, also while a state is being written.
class Checkpoints : public Resume {
  protected:
    static ino_t inode_of(const std::string& path) {
        struct stat status {};
        return ::stat(path.c_str(), &status) == 0 ? status.st_ino : 0;
    }
    // Renders until a checkpoint has been saved, and kills the process up to `microseconds` later.
    void kill_after_a_checkpoint(unsigned microseconds) const {
        const ino_t before = inode_of(state);
        std::vector<std::string> all =
            command("a.exr", {"--spp", endless, "--resume", "--quiet", "--checkpoint", "0.001"});
        const pid_t child = ::fork();
        if (child == 0) run_program(std::move(all));
        int status = 0;
        while (inode_of(state) == before) {
            ASSERT_EQ(::waitpid(child, &status, WNOHANG), 0) << exit_code(status);
            ::usleep(1'000);
        }
        ::usleep(microseconds);
        ::kill(child, SIGKILL);
        ASSERT_EQ(::waitpid(child, &status, 0), child);
        ASSERT_EQ(exit_code(status), 128 + SIGKILL);
    }
    void kill_again_and_again() const {
        std::mt19937 random(11);
        for (int i = 0; i < 8; ++i) {
            kill_after_a_checkpoint(random() % 40'000);
            ASSERT_FALSE(fs::exists(folder / "a.exr"));
        }
        interrupt(1);
        const int samples = samples_of(folder / "a.partial.exr");
        EXPECT_GE(samples, 1);
        expect_goes_on_to(samples + 23);
        for (const std::string& name : folder.names())
            EXPECT_EQ(name.find("marram-writing"), std::string::npos) << name;
    }
};

TEST_F(Checkpoints, ArePlacesToGoOnFromAfterAKill) { kill_again_and_again(); }

TEST_F(Checkpoints, KnowWhichPixelsWereDone) {
    settings = {"--set", "film.noise=0.004"};
    kill_again_and_again();
}

TEST_F(Checkpoints, AreRemovedWithTheFinishedPicture) {
    EXPECT_DONE(marram(with_samples("a.exr", 40, {"--checkpoint", "0.001"})));
    expect_uninterrupted_result(40);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.toml", "one.exr"}));
}

// The picture goes on, and one line says so.
TEST_F(Checkpoints, ThatCannotBeWrittenDoNotEndTheRender) {
    constexpr rlim_t room = 1 << 20; // bytes a file
    const auto in_little_room = [](std::vector<std::string> arguments) {
        const rlimit limit{room, room};
        ::setrlimit(RLIMIT_FSIZE, &limit);
        run_program(std::move(arguments));
    };
    const ProgramResult done = marram({"render", scene, "-o", folder / "a.exr", "--size", "256x192", "--spp",
                                       "40", "--checkpoint", "0.001"},
                                      in_little_room);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(lines(done.err).size(), 1u) << done.err;
    EXPECT_CONTAINS(done.err, state);
    EXPECT_CONTAINS(done.err, ": no checkpoint is saved");
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.toml"}));
}

} // namespace
} // namespace marram::testing
