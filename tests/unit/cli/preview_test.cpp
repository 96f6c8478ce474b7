// SPDX-License-Identifier: Apache-2.0
// --preview: a picture that can be opened at any moment while a frame renders.
#include "program.h"

#include "core/shot/preview.h"

#include <thread>

namespace marram::testing {
namespace {

// Wide enough that a reader can hit it while it is written.
const SceneText wide{.film =
                         "size = [160, 100]\nsamples = 8\nmax_depth = 3\naovs = [\"variance\", \"normal\"]\n",
                     .groom = "count = 3000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"};

// Its output goes to a file, so it has no terminal.
pid_t start(const std::vector<std::string>& arguments, const std::string& out) {
    load_image_library(); // once, or each child would load it again
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
        run_program(arguments);
    }
    return child;
}

// Reads the preview repeatedly until it has appeared with that many different sample counts.
void watch(const std::string& preview, size_t states, pid_t child) {
    std::set<int> seen;
    size_t reads = 0;
    while (seen.size() < states) {
        ASSERT_EQ(::waitpid(child, nullptr, WNOHANG), 0) << "it ended before its preview had changed";
        if (!fs::exists(preview)) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
            continue;
        }
        ASSERT_NO_THROW({
            const Image image = read_image(preview);
            ASSERT_EQ(image.width, 160);
            ASSERT_EQ(image.height, 100);
        });
        const int samples = std::stoi(read_metadata(preview, "marram:samples").value_or("0"));
        ASSERT_GE(samples, seen.empty() ? 1 : *seen.rbegin());
        EXPECT_EQ(read_metadata(preview, "marram:preview"), "yes");
        seen.insert(samples);
        ++reads;
    }
    EXPECT_EQ(*seen.begin(), 1) << "the first pass can be seen";
    EXPECT_GE(reads, states);
}

// After Ctrl-C the picture's name and --stats are written, since another program may wait for them.
void watch_endless(const std::string& name) {
    const Folder folder, streams;
    const std::string scene = folder.write("a.toml", wide);
    const pid_t child = start({"render", scene, "-o", folder / "a.exr", "--spp", "65536", "--quiet",
                               "--preview", folder / name, "--stats", streams / "stats.json"},
                              streams / "out");
    watch(folder / name, 3, child);
    ::kill(child, SIGINT);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(exit_code(status), 130);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr.state.tif", "a.partial.exr", "a.toml", name}));
    EXPECT_EQ(read_file(streams / "out"), folder / "a.partial.exr" + "\n");
    EXPECT_CONTAINS(read_file(streams / "stats.json"), "\"trace\"");
}

TEST(Preview, CanBeReadAtAnyMomentAsExr) { watch_endless("p.exr"); }
TEST(Preview, CanBeReadAtAnyMomentAsPng) { watch_endless("p.png"); }

TEST(Preview, EndsAsThePicture) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", wide);
    const std::vector<std::string> render = {"render", scene,   "--set", "film.exposure=1",
                                             "--aov",  "depth", "--spp"};
    const auto rendered = [&](const std::string& spp, std::vector<std::string> more) {
        more.insert(more.begin(), spp);
        more.insert(more.begin(), render.begin(), render.end());
        const ProgramResult done = marram(more);
        EXPECT_EQ(done.code, 0) << done.err;
        EXPECT_EQ(done.err, "");
        return lines(done.out).size();
    };
    for (const char* spp : {"1", "6"}) {
        EXPECT_EQ(rendered(spp, {"-o", folder / "a.exr", "--preview", folder / "p.exr"}), 1u);
        EXPECT_TRUE(same_picture(folder / "a.exr", folder / "p.exr"));
        EXPECT_EQ(read_metadata(folder / "p.exr", "marram:samples"), spp);
        EXPECT_EQ(read_metadata(folder / "p.exr", "marram:digest"), "preview")
            << "--resume must not take it for a frame";
        EXPECT_EQ(read_metadata(folder / "a.exr", "marram:preview"), std::nullopt);
        EXPECT_EQ(rendered(spp, {"-o", folder / "b.exr", "--preview", folder / "p.png"}), 1u);
        EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr")) << "it is only looked at";
    }
    EXPECT_DONE(marram({"render", scene, "--set", "film.exposure=1", "--set", "film.aovs=[]", "--spp", "6",
                        "-o", folder / "a.png"}));
    EXPECT_TRUE(same_picture(folder / "a.png", folder / "p.png"));
}

TEST(Preview, OfManyFramesIsTheLastOrEachItsOwn) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_EQ(marram({"render", scene, "-o", folder / "f.#.exr", "--frames", "1-2", "--preview",
                      folder / "p.#.exr"})
                  .code,
              0);
    EXPECT_EQ(
        marram({"render", scene, "-o", folder / "g.#.exr", "--frames", "1-2", "--preview", folder / "q.exr"})
            .code,
        0);
    EXPECT_TRUE(same_picture(folder / "f.1.exr", folder / "p.1.exr"));
    EXPECT_TRUE(same_picture(folder / "f.2.exr", folder / "p.2.exr"));
    EXPECT_TRUE(same_picture(folder / "f.2.exr", folder / "q.exr"));
}

TEST(Preview, IsAFileOfItsOwn) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const auto before = folder.contents();
    const auto refused = [&](const std::string& output, const std::string& preview,
                             const char* frames = "1-10") {
        const ProgramResult done = marram(
            {"render", scene, "-o", folder / output, "--frames", frames, "--preview", folder / preview});
        EXPECT_EQ(done.code, 2) << preview;
        EXPECT_EQ(lines(done.err).size(), 1u) << done.err;
        EXPECT_TRUE(folder.contents() == before);
        return done.err;
    };
    EXPECT_CONTAINS(refused("a.exr", "a.exr", "1-1"), "this would overwrite");
    EXPECT_CONTAINS(refused("a.exr", "./a.exr", "1-1"), "this would overwrite");
    EXPECT_CONTAINS(refused("a.exr", "a.partial.exr", "1-1"), "this would overwrite");
    EXPECT_CONTAINS(refused("f.#.exr", "f.3.exr"), "this would overwrite");
    EXPECT_CONTAINS(refused("f.##.exr", "f.#.exr"), "this would overwrite"); // at frame 10
    EXPECT_CONTAINS(refused("f.#.exr", "f.1#.exr", "0-10"),
                    "this would overwrite"); // frame 0 of one is frame 10 of the other
    EXPECT_CONTAINS(refused("a.exr", "a.toml", "1-1"), "cannot be written in the format");
    EXPECT_CONTAINS(refused("a.exr", "no/p.png", "1-1"), "does not exist");
}

// A failing preview does not stop the frame.
TEST(Preview, ThatFailsIsGivenUp) {
    int written = 0;
    Preview preview([&] {
        ++written;
        throw InputError({"p.png"}, "could not be written", "check the disk");
    });
    preview.show_if_due();
    preview.show_if_due();
    preview.finish();
    EXPECT_EQ(written, 1);
    EXPECT_EQ(to_string(preview.fault().value()), "p.png: could not be written: check the disk");
}

TEST(Preview, TakesAFewPercentOfTheTime) {
    EXPECT_DOUBLE_EQ(preview_pause(0.0, 0.0), 1.0);
    for (const double cost : {0.01, 0.5, 3.0}) EXPECT_GE(preview_pause(cost, 0.0), 40.0 * cost);
    EXPECT_GT(preview_pause(0.01, 1000.0), 10.0);
    EXPECT_LT(preview_pause(0.01, 1000.0), 100.0);
}

} // namespace
} // namespace marram::testing
