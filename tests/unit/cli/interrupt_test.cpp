// SPDX-License-Identifier: Apache-2.0
// Ctrl-C in each phase. The program sees a terminal, so that its progress line tells when a phase has begun;
// no clock is looked at.
#include "program.h"

#include <csignal>

#include <pty.h>

namespace marram::testing {
namespace {

// Runs the program on a terminal and sends it a signal once `phase` stands in its progress line. Returns its
// exit code.
int interrupt_in(const std::string& phase, const std::vector<std::string>& arguments, int signal = SIGINT) {
    int terminal = -1;
    const pid_t child = ::forkpty(&terminal, nullptr, nullptr, nullptr);
    if (child == 0) run_program(arguments);
    std::string seen;
    bool sent = false;
    char buffer[4096];
    for (ssize_t count = 0; (count = ::read(terminal, buffer, sizeof buffer)) > 0;) {
        seen.append(buffer, size_t(count));
        if (sent || seen.find(phase) == std::string::npos) continue;
        ::kill(child, signal);
        sent = true;
    }
    ::close(terminal);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(sent) << "the phase was over before it could be seen: " << seen;
    return exit_code(status);
}

// A picture that takes hours, of more strands than can be missed on their way.
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
    expect_untouched(names.contains("a.json")
                         ? std::set<std::string>{"a.exr", "a.json", "a.partial.exr", "a.toml"}
                         : std::set<std::string>{"a.exr", "a.partial.exr", "a.toml"});
    const Image image = read_image(folder / "a.partial.exr");
    EXPECT_EQ(image.width, 256);
    EXPECT_EQ(read_metadata(folder / "a.partial.exr", "marram:digest"), "partial");
}

TEST_F(Interrupt, BySigtermIsTheSame) {
    const std::string scene = folder.write("a.toml", long_picture);
    EXPECT_EQ(interrupt_in("rendering", {"render", scene, "-o", folder / "a.png"}, SIGTERM), 130);
    expect_untouched({"a.exr", "a.partial.png", "a.toml"});
}

TEST_F(Interrupt, OfManyFramesStopsThemAll) {
    const std::string scene = folder.write("a.toml", long_picture);
    EXPECT_EQ(interrupt_in("rendering", {"render", scene, "-o", folder / "f.####.exr", "--frames", "1-9"}),
              130);
    expect_untouched({"a.exr", "a.toml", "f.0001.partial.exr"});
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

// A procedural that does not ask whether to go on cannot keep the program.
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
