// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and other signals in each phase. The program runs on a terminal: its progress line shows when a
// phase has begun, so no test depends on a clock.
#include "program.h"

namespace marram::testing {
namespace {

// A picture that takes hours, with so many strands that each phase of the build can be interrupted.
const SceneText big = {.film = "size = [256, 256]\nsamples = 65536\n",
                       .groom = "count = 500000\ncvs = 8\nlength = [0.1, 0.2]\nwidth = 0.001\n"};
const SceneText long_picture = {.film = "size = [256, 256]\nsamples = 65536\n"};

class Interrupt : public ::testing::Test {
  protected:
    void SetUp() override { folder.write("a.exr", "an old picture"); }
    void expect_untouched(const std::set<std::string>& names) {
        EXPECT_EQ(read_file(folder / "a.exr"), "an old picture");
        EXPECT_EQ(folder.names(), names);
    }
    Folder folder;
};

TEST_F(Interrupt, InTheExpansionLeavesNothing) {
    const std::string scene = folder.write("a.toml", big);
    EXPECT_EQ(interrupt_in("expanding", {"render", scene, "-o", folder / "a.exr", "--threads", "1"}), 130);
    expect_untouched({"a.exr", "a.toml"});
}

TEST_F(Interrupt, InTheBvhLeavesNothing) {
    const std::string scene = folder.write("a.toml", big);
    EXPECT_EQ(interrupt_in("building the BVH", {"render", scene, "-o", folder / "a.exr"}), 130);
    expect_untouched({"a.exr", "a.toml"});
}

TEST_F(Interrupt, InTheRenderingLeavesAPartialPicture) {
    const std::string scene = folder.write("a.toml", long_picture);
    EXPECT_EQ(
        interrupt_in("rendering", {"render", scene, "-o", folder / "a.exr", "--stats", folder / "a.json"}),
        130);
    const std::set<std::string> names = folder.names();
    EXPECT_TRUE(names.contains("a.partial.exr"));
    expect_untouched(
        names.contains("a.json")
            ? std::set<std::string>{"a.exr", "a.exr.state.tif", "a.json", "a.partial.exr", "a.toml"}
            : std::set<std::string>{"a.exr", "a.exr.state.tif", "a.partial.exr", "a.toml"});
    const Image image = read_image(folder / "a.partial.exr");
    EXPECT_EQ(image.width, 256);
    EXPECT_EQ(read_metadata(folder / "a.partial.exr", "marram:digest"), "partial");
}

// Each signal is a checkpoint, and its exit code tells a batch system which it was.
TEST_F(Interrupt, BySignalsOfBatchSystemsIsTheSame) {
    const std::string scene = folder.write("a.toml", long_picture);
    for (const int signal : {SIGTERM, SIGHUP, SIGUSR1, SIGUSR2, SIGXCPU}) {
        EXPECT_EQ(interrupt_in("rendering", {"render", scene, "-o", folder / "a.png"}, signal), 128 + signal);
        expect_untouched({"a.exr", "a.partial.png", "a.png.state.tif", "a.toml"});
        fs::remove(folder / "a.partial.png");
        fs::remove(folder / "a.png.state.tif");
    }
}

// While the picture is built, nothing is there to save, and the work may end by itself or be cut off.
TEST_F(Interrupt, BySigtermInTheBuildHasItsExitCode) {
    const std::string scene = folder.write("a.toml", big);
    EXPECT_EQ(interrupt_in("expanding", {"render", scene, "-o", folder / "a.exr"}, SIGTERM), 143);
    expect_untouched({"a.exr", "a.toml"});
}

// timeout(1) sends its signal to the process and again to the group: the second must not break off the save.
TEST_F(Interrupt, ASecondSigtermDoesNotBreakOffTheSave) {
    const std::string scene = folder.write("a.toml", long_picture);
    const pid_t child = ::fork();
    if (child == 0) {
        for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) ::dup2(::open("/dev/null", O_WRONLY), stream);
        run_program({"render", scene, "-o", folder / "a.png", "--preview", folder / "p.png"});
    }
    while (!fs::exists(folder / "p.png") && ::waitpid(child, nullptr, WNOHANG) == 0) ::usleep(10'000);
    ::kill(child, SIGUSR1);
    for (int i = 0; i < 20; ++i) {
        ::kill(child, SIGTERM);
        ::usleep(5'000);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(exit_code(status), 128 + SIGUSR1) << "the first signal counts";
    expect_untouched({"a.exr", "a.partial.png", "a.png.state.tif", "a.toml", "p.png"});
}

TEST_F(Interrupt, OfManyFramesStopsThemAll) {
    const std::string scene = folder.write("a.toml", long_picture);
    EXPECT_EQ(interrupt_in("rendering", {"render", scene, "-o", folder / "f.####.exr", "--frames", "1-9"}),
              130);
    expect_untouched({"a.exr", "a.toml", "f.0001.exr.state.tif", "f.0001.partial.exr"});
}

TEST_F(Interrupt, OfABakeLeavesNothing) {
    const std::string scene = folder.write("a.toml", big);
    EXPECT_EQ(interrupt_in("expanding", {"bake", scene, "-o", folder / "a.usda", "--threads", "1"}), 130);
    expect_untouched({"a.exr", "a.toml"});
}

TEST_F(Interrupt, InTheWritingOfABakeLeavesNothing) {
    const std::string scene = folder.write("a.toml", big);
    EXPECT_EQ(interrupt_in("writing", {"bake", scene, "-o", folder / "a.usda"}), 130);
    expect_untouched({"a.exr", "a.toml"});
}

// A procedural that does not poll for cancellation cannot block the program.
TEST_F(Interrupt, OfAStuckLibraryIsCutOff) {
    const std::string scene = folder.write(
        "a.toml", "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[[procedural]]\nname = \"stuck\"\n"
                  "type = \"faulty_curves\"\nfault = \"stuck\"\nlibrary = \"" MARRAM_BINARY_DIR
                  "/libfaulty_plugin.so\"\n");
    EXPECT_EQ(interrupt_in("expanding", {"render", scene, "-o", folder / "a.exr"}), 130);
    expect_untouched({"a.exr", "a.toml"});
}

} // namespace
} // namespace marram::testing
