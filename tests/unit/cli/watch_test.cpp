// SPDX-License-Identifier: Apache-2.0
// --watch: renders anew when the scene or a file of it is saved. Each step waits for what the program prints.
#include "program.h"

#include <thread>

namespace marram::testing {
namespace {

// Its messages and results come through one pipe, in the order in which they are written.
class Watched {
  public:
    explicit Watched(const std::vector<std::string>& arguments) {
        load_image_library(); // once, or each child would load it again
        int ends[2] = {-1, -1};
        EXPECT_EQ(::pipe2(ends, O_CLOEXEC), 0);
        child_ = ::fork();
        if (child_ == 0) {
            ::dup2(ends[1], STDOUT_FILENO);
            ::dup2(ends[1], STDERR_FILENO);
            run_program(arguments);
        }
        ::close(ends[1]);
        output_ = ::fdopen(ends[0], "r");
    }
    ~Watched() { std::fclose(output_); }
    Watched(const Watched&) = delete;
    Watched& operator=(const Watched&) = delete;

    // The lines up to the one that says that it waits; "" and a failure if it ends.
    std::string until_it_waits() {
        std::string text;
        for (char line[4096]; std::fgets(line, sizeof line, output_);) {
            text += line;
            if (std::strstr(line, "waiting for the scene")) return text;
        }
        ADD_FAILURE() << "it ended: " << text;
        return "";
    }
    int interrupted() {
        ::kill(child_, SIGINT);
        int status = 0;
        ::waitpid(child_, &status, 0);
        return exit_code(status);
    }

  private:
    pid_t child_ = -1;
    std::FILE* output_ = nullptr;
};

TEST(Watch, RendersAgainWhatIsSaved) {
    const Folder folder;
    folder.write("ground.obj", "v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3 4\n");
    const auto scene_of = [](const std::string& speed, const std::string& more = "") {
        return SceneText{
            .film = "size = [32, 16]\nsamples = 2\n", // twice as wide as high: an environment, too
            .wind = "speed = " + speed + "\n",
            .more = "[[mesh]]\nname = \"tile\"\ntype = \"file\"\nfile = \"ground.obj\"\n" + more};
    };
    const std::string scene = folder.write("a.toml", scene_of("6"));
    const auto alone = [&] { // what a render without --watch makes of the scene
        EXPECT_DONE(marram({"render", scene, "-o", folder / "b.exr", "--frame", "3", "--set",
                            "film.exposure=1", "--aov", "depth"}));
        return folder / "b.exr";
    };
    Watched watched({"render", scene, "-o", folder / "a.exr", "--frame", "3", "--set", "film.exposure=1",
                     "--aov", "depth", "--stats", folder / "a.json", "--watch"});
    const std::string first = watched.until_it_waits();
    EXPECT_EQ(lines(first).size(), 1u) << first;
    EXPECT_TRUE(first.starts_with(folder / "a.exr" + ": written, ")) << first;
    EXPECT_TRUE(same_picture(folder / "a.exr", alone()));
    EXPECT_CONTAINS(read_file(folder / "a.json"), "\"trace\"");
    fs::remove(folder / "a.json");

    folder.write("a.toml", scene_of("3"));
    EXPECT_EQ(lines(watched.until_it_waits()).size(), 1u);
    EXPECT_FALSE(same_picture(folder / "a.exr", folder / "b.exr"));
    EXPECT_TRUE(same_picture(folder / "a.exr", alone()));
    EXPECT_CONTAINS(read_file(folder / "a.json"), "\"trace\"");

    folder.write("ground.obj", "v -1 0.5 -1\nv -1 0.5 1\nv 1 0.5 1\nv 1 0.5 -1\nf 1 2 3 4\n");
    EXPECT_EQ(lines(watched.until_it_waits()).size(), 1u);
    EXPECT_FALSE(same_picture(folder / "a.exr", folder / "b.exr")) << "a file that the scene names";
    EXPECT_TRUE(same_picture(folder / "a.exr", alone()));

    folder.write("a.toml", scene_of("\"fast\""));
    const std::string mistake = watched.until_it_waits();
    EXPECT_EQ(lines(mistake).size(), 2u) << mistake;
    EXPECT_TRUE(mistake.starts_with(scene + ":9:9: wind.speed")) << mistake;
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr")) << "the picture stays";

    // One that only the output's check finds: the picture would overwrite a file of the scene.
    folder.write("a.toml", scene_of("9", "[[light]]\ntype = \"environment\"\nfile = \"a.exr\"\n"));
    const std::string overwritten = watched.until_it_waits();
    EXPECT_CONTAINS(overwritten, "this would overwrite");
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr"));

    folder.write("a.toml", scene_of("9"));
    EXPECT_EQ(lines(watched.until_it_waits()).size(), 1u);
    EXPECT_TRUE(same_picture(folder / "a.exr", alone()));
    EXPECT_EQ(watched.interrupted(), 0) << "it was waiting";
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.json", "a.toml", "b.exr", "ground.obj"}));
}

void wait_for(const std::string& file) {
    while (!fs::exists(file)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

// A picture that takes hours: only a render that is stopped can end.
TEST(Watch, ASaveStopsTheRender) {
    const Folder folder;
    const auto scene_of = [](const std::string& samples) {
        return SceneText{.film = "size = [64, 64]\nsamples = " + samples + "\n"};
    };
    const std::string scene = folder.write("a.toml", scene_of("65536"));
    Watched watched(
        {"render", scene, "-o", folder / "a.exr", "--frame", "3", "--preview", folder / "p.exr", "--watch"});
    wait_for(folder / "p.exr");
    folder.write("a.toml", scene_of("2"));
    EXPECT_EQ(lines(watched.until_it_waits()).size(), 1u);
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:samples"), "2");
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.toml", "p.exr"})) << "nothing is partial";

    fs::remove(folder / "p.exr");
    folder.write("a.toml", scene_of("65535"));
    wait_for(folder / "p.exr");
    EXPECT_EQ(watched.interrupted(), 130) << "as without --watch";
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:samples"), "2");
    EXPECT_EQ(folder.names(),
              (std::set<std::string>{"a.exr", "a.exr.state.tif", "a.partial.exr", "a.toml", "p.exr"}));
}

TEST(Watch, RefusesWhatItCannotShow) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{}),
                      bad = folder.write("b.toml", "[camera]\nposition = 3\n");
    const auto before = folder.contents();
    const auto refused = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), "render");
        arguments.emplace_back("--watch");
        const ProgramResult done = marram(arguments);
        EXPECT_EQ(done.code, 2);
        EXPECT_EQ(done.out, "");
        EXPECT_TRUE(folder.contents() == before);
        return done.err;
    };
    EXPECT_EQ(refused({scene, "-o", folder / "a.####.png"}),
              "--watch: it renders one frame, and these are 10: say which with --frame\n");
    EXPECT_CONTAINS(refused({scene, "-o", folder / "a.png", "--resume"}), "--resume");
    EXPECT_CONTAINS(refused({bad, "-o", folder / "a.png"}), bad + ":2:12: ");
    EXPECT_CONTAINS(refused({folder / "no.toml", "-o", folder / "a.png"}), "no.toml");
}

} // namespace
} // namespace marram::testing
