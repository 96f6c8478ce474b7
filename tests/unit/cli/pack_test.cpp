// SPDX-License-Identifier: Apache-2.0
// marram pack: a scene and all that it names in one folder, which renders to the same bits elsewhere.
#include "program.h"

#include "core/image/image.h"
#include "core/shot/farm/pack.h"

#include <chrono>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

namespace marram::testing {
namespace {

class Pack : public ::testing::Test {
  protected:
    void SetUp() override {
        for (const char* name : {"show/a", "show/b", "away"}) fs::create_directories(folder / name);
    }
    std::string triangle(const std::string& name, double height) const {
        return folder.write(name, fmt::format("v 0 0 0\nv 1 0 0\nv 0 0 {}\nf 1 3 2\n", height));
    }
    void image(const std::string& name, float grey) const {
        const std::vector<float> pixels(3 * 4 * 2, grey);
        write_png(folder / name, 4, 2, 3, pixels.data(), 0.0);
    }
    ProgramResult pack(const std::string& scene, std::vector<std::string> more = {}) const {
        more.insert(more.begin(), {"pack", scene, "-o", folder / "packed"});
        return marram(more);
    }
    // The packed scene in the folder that it was moved to.
    std::string moved(const std::string& scene) const {
        fs::remove_all(folder / "away");
        fs::rename(folder / "packed", folder / "away");
        return folder / ("away/" + fs::path(scene).filename().string());
    }
    // No folder was made, and none was left.
    void expect_nothing_written() const {
        for (const auto& entry : fs::directory_iterator(folder / ""))
            EXPECT_FALSE(entry.path().filename().string().starts_with("packed")) << entry.path();
    }
    Folder folder;
};

const std::string camera_and_film =
    "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[film]\nsize = [32, 24]\nsamples = 1\n";

TEST_F(Pack, KeepsAllButTheNamesOfFiles) {
    triangle("show/a/m.obj", 1);
    triangle("show/b/m.obj", 2);     // the same name, another file
    triangle("show/b/M.OBJ", 3);     // a system may take it for the same
    triangle("show/b/again.obj", 1); // another name, the same contents
    for (int i = 1; i <= 3; ++i) triangle(fmt::format("show/b/s.{:04}.obj", i), i);
    image("show/sky.png", 0.5F);
    image("show/a/t.1001.png", 0.2F);
    image("show/a/t.1002.png", 0.3F);
    const std::string text = camera_and_film + R"(# of the sky
[[light]]
type = "environment"
file = 'sky.png'   # it has no name
[[material]]
name = "paint = red"
type = "surface"
color_map = "a/t.<UDIM>.png"
)" +
                             fmt::format(R"([[mesh]]
name = "one"
type = "file"
file = "a/m.obj" # one
[[mesh]]
name = "two"
type = "file"
file = "{}"
[[mesh]]
name = "three.x"
type = "file"
file = "b/../b/M.OBJ"
[[mesh]]
type = "file"
file = "b/again.obj"
name = "four"
material = "paint = red"
[[mesh]]
name = "five"
type = "file"
file = "b/s.####.obj"
file_frames = [1, 3]
)",
                                         folder / "show/b/m.obj");
    const std::string scene = folder.write("show/scene.toml", text);
    const auto old = fs::file_time_type::clock::now() - std::chrono::hours(300);
    fs::last_write_time(folder / "show/a/m.obj", old);
    const ProgramResult done = pack(scene);
    ASSERT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.out, folder / "packed/scene.toml" + "\n");

    std::string wanted = text;
    const auto replace = [&](const std::string& from, const std::string& to) {
        ASSERT_NE(wanted.find(from), std::string::npos) << from;
        wanted.replace(wanted.find(from), from.size(), to);
    };
    replace("'sky.png'", "\"files/sky.png\"");
    replace("\"a/t.<UDIM>.png\"", "\"files/t.<UDIM>.png\"");
    replace("\"a/m.obj\"", "\"files/m.obj\"");
    replace("\"" + folder / "show/b/m.obj" + "\"", "\"files/2/m.obj\"");
    replace("\"b/../b/M.OBJ\"", "\"files/3/M.OBJ\"");
    replace("\"b/again.obj\"", "\"files/m.obj\"");
    replace("\"b/s.####.obj\"", "\"files/s.####.obj\"");
    EXPECT_EQ(read_file(folder / "packed/scene.toml"), wanted);
    const std::map<std::string, std::string> copies = {
        {"files/m.obj", "a/m.obj"},           {"files/2/m.obj", "b/m.obj"},
        {"files/3/M.OBJ", "b/M.OBJ"},         {"files/s.0001.obj", "b/s.0001.obj"},
        {"files/s.0002.obj", "b/s.0002.obj"}, {"files/s.0003.obj", "b/s.0003.obj"},
        {"files/sky.png", "sky.png"},         {"files/t.1001.png", "a/t.1001.png"},
        {"files/t.1002.png", "a/t.1002.png"}};
    size_t count = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "packed"))
        count += entry.is_regular_file() ? 1 : 0;
    EXPECT_EQ(count, copies.size() + 1);
    for (const auto& [to, from] : copies)
        EXPECT_EQ(read_file(folder / ("packed/" + to)), read_file(folder / ("show/" + from))) << to;
    EXPECT_EQ(fs::last_write_time(folder / "packed/files/m.obj"), old);
    EXPECT_DONE(marram({"info", moved(scene)}));
}

TEST_F(Pack, WritesSettingsIntoTheScene) {
    triangle("show/a/m.obj", 1);
    triangle("show/b/other.obj", 2);
    const std::string scene = folder.write(
        "show/scene.toml", camera_and_film + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"a/m.obj\"\n");
    const ProgramResult done =
        pack(scene, {"--set", "film.samples=3", "--set", "mesh.m.file=/studio/other.obj", "--map",
                     "/studio=" + folder / "show/b"});
    ASSERT_EQ(done.code, 0) << done.err;
    const std::string packed = read_file(moved(scene));
    EXPECT_CONTAINS(packed, "samples = 3\n");
    EXPECT_CONTAINS(packed, "file = \"files/other.obj\"\n");
    EXPECT_FALSE(fs::exists(folder / "away/files/m.obj"));
}

TEST_F(Pack, RendersToTheSameBitsElsewhere) {
    for (const char* name : {"leopard", "figure1a", "downwash"}) {
        const std::string scene = fmt::format("{}/scenes/{}.toml", MARRAM_SOURCE_DIR, name);
        const ProgramResult done = pack(scene, {"--quiet"});
        ASSERT_EQ(done.code, 0) << done.err;
        const auto render = [&](const std::string& of, const std::string& output) {
            const ProgramResult made = marram({"render", of, "-o", folder / output, "--size", "32x24",
                                               "--spp", "1", "--quiet", "--state", folder / "states"});
            EXPECT_EQ(made.code, 0) << made.err;
        };
        render(scene, "there.exr");
        render(moved(scene), "here.exr");
        EXPECT_TRUE(same_picture(folder / "there.exr", folder / "here.exr")) << name;
    }
}

TEST_F(Pack, WithStatesSimulatesNothingAgain) {
    folder.write("show/a/rock.obj",
                 "v -1 0 -1\nv -1 0 1\nv -1 2 0\nv 1 0 0\nf 1 2 3\nf 4 3 2\nf 4 1 3\nf 4 2 1\n");
    const std::string scene = folder.write(
        "show/scene.toml", camera_and_film +
                               "[wind]\nspeed = 12\n[[mesh]]\nname = \"given\"\ntype = \"file\"\n"
                               "file = \"a/rock.obj\"\nsmooth = false\n[[procedural]]\nname = \"worn\"\n"
                               "type = \"rock\"\nmesh = \"given\"\nsand_level = 0\nlevels = 3\n"
                               "voxel = 0.05\nyears = 1\npaths = 2000\n");
    const ProgramResult none = pack(scene, {"--states"});
    EXPECT_EQ(none.code, 2);
    EXPECT_CONTAINS(none.err, "there are no states of simulations: render or bake the scene first");
    expect_nothing_written();
    const auto bake = [&](const std::string& of, const std::string& output) {
        const ProgramResult done = marram({"bake", of, "-o", folder / output, "--quiet"});
        EXPECT_EQ(done.code, 0) << done.err;
    };
    const auto states_in = [&](const std::string& name) {
        std::map<std::string, fs::file_time_type> all;
        for (const auto& entry : fs::recursive_directory_iterator(folder / name))
            if (entry.is_regular_file())
                all[fs::relative(entry.path(), folder / name).string()] = fs::last_write_time(entry.path());
        return all;
    };
    bake(scene, "there.ply");
    const auto before = states_in("show/scene.states");
    EXPECT_FALSE(before.empty());
    folder.write("show/scene.states/1.marram-writing-0123abcd.state", "half");
    const ProgramResult done = pack(scene, {"--states"});
    ASSERT_EQ(done.code, 0) << done.err;
    bake(moved(scene), "here.ply");
    EXPECT_EQ(states_in("away/scene.states"), before); // neither written again nor more of them
    EXPECT_EQ(read_file(folder / "here.ply"), read_file(folder / "there.ply"));
}

TEST_F(Pack, WritesNothingIfAFileIsMissing) {
    triangle("show/a/m.obj", 1);
    const std::string text = camera_and_film +
                             "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"a/m.obj\"\n"
                             "[[material]]\nname = \"p\"\ntype = \"surface\"\ncolor_map = \"a/none.png\"\n";
    const ProgramResult done = pack(folder.write("show/scene.toml", text));
    EXPECT_EQ(done.code, 2);
    EXPECT_CONTAINS(done.err, "scene.toml:14:13: ");
    expect_nothing_written();
}

TEST_F(Pack, ReplacesNothingButAnEmptyFolder) {
    triangle("show/a/m.obj", 1);
    const std::string scene = folder.write(
        "show/scene.toml", camera_and_film + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"a/m.obj\"\n");
    fs::create_directories(folder / "packed");
    EXPECT_EQ(pack(scene).code, 0);
    const auto before = folder.contents();
    const ProgramResult full = pack(scene);
    EXPECT_EQ(full.code, 2);
    EXPECT_CONTAINS(full.err, "this folder is not empty: name another");
    for (const char* output : {"none/packed", "show/scene.toml", "show", ""})
        EXPECT_EQ(marram({"pack", scene, "-o", *output ? folder / output : output}).code, 2) << output;
    EXPECT_EQ(folder.contents(), before);
    EXPECT_EQ(marram({"pack", scene, "-o", folder / "with_slash/"}).code, 0);
    EXPECT_TRUE(fs::exists(folder / "with_slash/files/m.obj"));
}

TEST_F(Pack, RefusesLibraries) {
    const auto built = [](const std::string& name) {
        for (const auto& entry : fs::recursive_directory_iterator(MARRAM_BINARY_DIR))
            if (entry.path().filename() == name) return entry.path().string();
        return std::string();
    };
    const std::string library = folder / "show/libmine.so";
    fs::copy_file(built("libterrain_plugin.so"), library);
    const auto scene = [&](const std::string& name) {
        return folder.write("show/scene.toml",
                            camera_and_film + "[[procedural]]\nname = \"p\"\ntype = \"hill\"\nlibrary = \"" +
                                name + "\"\n");
    };
    const ProgramResult done = pack(scene("libmine.so"), {"--allow-library", library});
    EXPECT_EQ(done.code, 2);
    EXPECT_CONTAINS(done.err, "a library is code, and is not packed: install it where the folder goes");
    expect_nothing_written();
}

TEST_F(Pack, LeavesNothingAfterAnInterrupt) {
    triangle("show/a/m.obj", 1);
    const std::string scene = folder.write(
        "show/scene.toml", camera_and_film + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"a/m.obj\"\n");
    static const std::atomic<bool> go{false};
    const std::atomic<bool> stop{true};
    EXPECT_THROW(pack_scene(load_shot(scene, {}, go), {scene, folder / "packed", {}, false}, stop),
                 Cancelled);
    expect_nothing_written();
}

// One that a process still holds is locked.
TEST_F(Pack, RemovesWhatAKilledProcessHasLeft) {
    const std::string scene = folder.write("show/s.toml", SceneText());
    for (const char* name : {"packed.marram-packing-0123abcd/files", "packed.marram-packing-4567cdef",
                             "packed.marram-packing-mine", "other.marram-packing-0123abcd"})
        fs::create_directories(folder / name);
    const int held =
        ::open((folder / "packed.marram-packing-4567cdef").c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    ASSERT_EQ(::flock(held, LOCK_EX), 0);
    EXPECT_EQ(pack(scene).code, 0);
    ::close(held);
    EXPECT_FALSE(fs::exists(folder / "packed.marram-packing-0123abcd"));
    EXPECT_TRUE(fs::exists(folder / "packed.marram-packing-4567cdef"));
    EXPECT_TRUE(fs::exists(folder / "packed.marram-packing-mine"));
    EXPECT_TRUE(fs::exists(folder / "other.marram-packing-0123abcd"));
}

} // namespace
} // namespace marram::testing
