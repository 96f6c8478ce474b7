// SPDX-License-Identifier: Apache-2.0
// Digests of a scene and its files do not depend on where they lie: states of several machines go together.
#include "program.h"

#include "core/shot/frame.h"
#include "core/shot/scene/scene_files.h"

#include <chrono>

namespace marram::testing {
namespace {

const std::atomic<bool> never_stopped{false};

std::string triangle_obj(double height) {
    return fmt::format("v 0 0 0\nv 1 0 0\nv 0 0 {}\nf 1 3 2\n", height);
}

const std::string plain_scene = "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n";
const std::string mesh_scene =
    plain_scene + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"meshes/m.obj\"\n";
const std::string sequence_scene =
    plain_scene +
    "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"meshes/m.##.obj\"\nfile_frames = [1, 3]\n";

class SceneDigest : public ::testing::Test {
  protected:
    // Writes a scene into a folder of its own, with meshes.
    std::string write(const std::string& name, const std::string& text) const {
        fs::create_directories(folder / (name + "/meshes"));
        folder.write(name + "/meshes/m.obj", triangle_obj(1));
        for (int i = 1; i <= 3; ++i)
            folder.write(fmt::format("{}/meshes/m.{:02}.obj", name, i), triangle_obj(i));
        return folder.write(name + "/scene.toml", text);
    }
    static uint64_t digest(const std::string& scene, const std::vector<std::string>& settings = {}) {
        Overrides overrides;
        overrides.settings = settings;
        const Shot shot = load_shot(scene, overrides, never_stopped);
        FrameOptions options;
        options.scene = scene;
        return shot_digest(shot, options, settings);
    }
    static void set_time(const std::string& file, int seconds) {
        fs::last_write_time(file, fs::file_time_type::clock::now() - std::chrono::seconds(seconds));
    }
    Folder folder;
};

TEST_F(SceneDigest, IsTheSameInAnotherFolderAtAnotherTime) {
    const std::string a = write("a", mesh_scene), b = write("b", mesh_scene);
    set_time(folder / "b/meshes/m.obj", 5000);
    EXPECT_EQ(digest(a), digest(b));
}

TEST_F(SceneDigest, ChangesWithOneByteOfAFile) {
    const std::string a = write("a", mesh_scene), b = write("b", mesh_scene);
    folder.write("b/meshes/m.obj", triangle_obj(2)); // the same size
    fs::last_write_time(folder / "b/meshes/m.obj", fs::last_write_time(folder / "a/meshes/m.obj"));
    EXPECT_NE(digest(a), digest(b));
}

TEST_F(SceneDigest, ChangesWithTheOrderOfFiles) {
    const std::string two =
        mesh_scene + "[[mesh]]\nname = \"n\"\ntype = \"file\"\nfile = \"meshes/m.01.obj\"\n";
    const std::string a = write("a", two), b = write("b", two);
    folder.write("b/meshes/m.obj", triangle_obj(7));
    folder.write("b/meshes/m.01.obj", triangle_obj(1));
    folder.write("a/meshes/m.01.obj", triangle_obj(7));
    EXPECT_NE(digest(a), digest(b));
}

TEST_F(SceneDigest, DoesNotDependOnTheFolderOfASetting) {
    const std::string a = write("a", mesh_scene), b = write("b", mesh_scene);
    const auto with = [&](const std::string& scene, const std::string& mesh) {
        return digest(scene, {"mesh.m.file=" + mesh});
    };
    EXPECT_EQ(with(a, folder / "a/meshes/m.02.obj"), with(b, folder / "b/meshes/m.02.obj"));
    EXPECT_NE(with(a, folder / "a/meshes/m.02.obj"), with(b, folder / "b/meshes/m.03.obj"));
    EXPECT_NE(digest(a, {"film.samples=3"}), digest(a, {"film.samples=4"}));
}

// Their contents are not read for it: names, sizes and times tell.
TEST_F(SceneDigest, OfASequenceIsByNameSizeAndTime) {
    const std::string a = write("a", sequence_scene), b = write("b", sequence_scene);
    const auto copy_times = [&] {
        for (const char* name : {"m.01.obj", "m.02.obj", "m.03.obj"})
            fs::last_write_time(folder / ("b/meshes/" + std::string(name)),
                                fs::last_write_time(folder / ("a/meshes/" + std::string(name))));
    };
    copy_times();
    EXPECT_EQ(digest(a), digest(b));
    set_time(folder / "b/meshes/m.02.obj", 5000);
    EXPECT_NE(digest(a), digest(b));
    folder.write("b/meshes/m.02.obj", triangle_obj(2.25));
    copy_times();
    EXPECT_NE(digest(a), digest(b));
}

// Also beyond one block, and at every block's end.
TEST_F(SceneDigest, OfContentsCoversEveryByte) {
    std::string bytes((size_t(9) << 20) + 5, 'x');
    const std::string file = folder.write("big", bytes), empty = folder.write("empty", "");
    const uint64_t before = content_digests({file})[0];
    EXPECT_NE(before, 0U);
    for (const size_t at : {size_t(0), size_t(4) << 20, (size_t(8) << 20) - 1, bytes.size() - 1}) {
        bytes[at] = 'y';
        folder.write("big", bytes);
        EXPECT_NE(content_digests({file})[0], before) << at;
        bytes[at] = 'x';
    }
    const auto several = content_digests({folder.write("big", bytes), folder / "none", empty});
    EXPECT_EQ(several[0], before);
    EXPECT_EQ(several[1], 0U);
    EXPECT_NE(several[2], 0U);
}

} // namespace
} // namespace marram::testing
