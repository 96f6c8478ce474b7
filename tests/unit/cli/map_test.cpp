// SPDX-License-Identifier: Apache-2.0
// --map and --map-file: a scene whose files lie elsewhere on this machine.
#include "program.h"

namespace marram::testing {
namespace {

const std::string triangle_mesh = "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 3 2\n";
const std::string lit_scene = "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[film]\nsize = [24, 16]\n"
                              "samples = 1\n[[light]]\ntype = \"sky\"\n";

class MappedScene : public ::testing::Test {
  protected:
    std::string scene_with(const std::string& file) const {
        return folder.write("a.toml",
                            lit_scene + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = '" + file + "'\n");
    }
    static ProgramResult info(const std::string& scene, std::vector<std::string> more) {
        more.insert(more.begin(), {"info", scene});
        return marram(more);
    }
    std::string map_file(const std::string& format, const std::string& from, const std::string& to) const {
        return folder.write("map.json",
                            fmt::format("{{\"version\": \"pathmapping-1.0\", \"path_mapping_rules\": "
                                        "[{{\"source_path_format\": \"{}\", \"source_path\": \"{}\", "
                                        "\"destination_path\": \"{}\"}}]}}",
                                        format, from, to));
    }
    Folder folder;
    std::string here = folder / "here";
    void SetUp() override {
        fs::create_directories(here);
        folder.write("here/m.obj", triangle_mesh);
    }
};

TEST_F(MappedScene, FindsItsFilesByEveryCommand) {
    const std::string scene = scene_with("/studio/show/m.obj"), map = "/studio/show=" + here;
    EXPECT_EQ(info(scene, {}).code, 2);
    EXPECT_DONE(info(scene, {"--map", map}));
    EXPECT_DONE(info(scene, {"--keys", "--map", map}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.png", "--map", map, "--quiet"}));
    EXPECT_DONE(info(scene, {"--map", "/studio=/nowhere", "--map", map})); // the longest
    EXPECT_DONE(info(scene, {"--map-file", map_file("POSIX", "/studio/show", here)}));
    const ProgramResult both =
        info(scene, {"--map-file", map_file("POSIX", "/studio/show", "/nowhere"), "--map", map});
    EXPECT_DONE(both); // of equals that of the command line
}

TEST_F(MappedScene, MayComeFromWindows) {
    const std::string scene = scene_with(R"(P:\Show\m.obj)");
    EXPECT_DONE(info(scene, {"--map", R"(p:\show=)" + here}));
    EXPECT_DONE(info(scene, {"--map-file", map_file("WINDOWS", R"(p:\\show)", here)}));
}

TEST_F(MappedScene, MapsRelativeNamesAndSettings) {
    const std::string scene = scene_with("meshes/m.obj");
    EXPECT_DONE(info(scene, {"--map", "meshes=" + here}));
    EXPECT_DONE(info(scene, {"--map", "meshes=here"})); // relative to the scene's folder
    EXPECT_DONE(info(scene, {"--set", "mesh.m.file=/studio/m.obj", "--map", "/studio=" + here}));
}

TEST_F(MappedScene, ErrorsNameBothPaths) {
    const std::string scene = scene_with("/studio/show/other.obj");
    const ProgramResult done = info(scene, {"--map", "/studio/show=" + here});
    EXPECT_EQ(done.code, 2);
    EXPECT_EQ(lines(done.err).size(), 1U);
    EXPECT_CONTAINS(done.err, "a.toml:12:8: ");
    EXPECT_CONTAINS(done.err, "\"" + here.substr(0, 10)); // long names are cut in the middle
    EXPECT_CONTAINS(done.err, "(mapped from \"/studio/show/other.obj\")");
    const ProgramResult unknown = info(scene, {"--map", "nothing"});
    EXPECT_EQ(unknown.code, 2);
    EXPECT_CONTAINS(unknown.err, "--map nothing: is no mapping of paths: write FROM=TO");
    const ProgramResult no_scene = info("groom", {"--map", "a=b"});
    EXPECT_EQ(no_scene.code, 2);
    const ProgramResult file =
        info(scene, {"--map-file", folder.write("bad.json", "{\n  \"version\": 2\n}")});
    EXPECT_EQ(file.code, 2);
    EXPECT_CONTAINS(file.err, "bad.json:2:14: the version is 2");
}

// A path that a rule leads to needs the permission that any other path needs.
TEST_F(MappedScene, LeadsToNoLibraryWithoutPermission) {
    const std::string copy = here + "/libother.so";
    const auto built = [&] {
        for (const auto& entry : fs::recursive_directory_iterator(MARRAM_BINARY_DIR))
            if (entry.path().filename() == "libterrain_plugin.so") return entry.path().string();
        return std::string();
    }();
    ASSERT_NE(built, "");
    fs::copy_file(built, copy);
    const std::string scene = folder.write(
        "a.toml",
        lit_scene + "[[procedural]]\nname = \"p\"\ntype = \"hills\"\nlibrary = '/studio/libother.so'\n");
    const ProgramResult refused = info(scene, {"--map", "/studio=" + here});
    EXPECT_EQ(refused.code, 2);
    EXPECT_CONTAINS(refused.err, "the scene asks to run the code of the library \"" + copy + "\"");
    const ProgramResult allowed = info(scene, {"--map", "/studio=" + here, "--allow-library", copy});
    EXPECT_EQ(allowed.err.find("asks to run"), std::string::npos) << allowed.err;
}

} // namespace
} // namespace marram::testing
