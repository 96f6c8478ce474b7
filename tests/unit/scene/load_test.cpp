// SPDX-License-Identifier: Apache-2.0
// Good scenes arrive whole; files that are no scene at all are refused in one clear line.
#include "core/scene/libraries.h"
#include "scene_test.h"

#include <algorithm>
#include <gtest/gtest.h>
#include <sys/stat.h>

namespace marram {
namespace {

using Numbers = std::vector<double>;

// The schema outlives the description, which points into it.
struct FullScene {
    Schema schema = test_schema();
    Folder folder;
    SceneDescription scene;
    FullScene() {
        folder.write("mesh.obj", "");
        folder.write("sky.exr", "");
        scene = load_scene(folder.write("scene.toml", full_scene), {}, schema);
    }
};

TEST(LoadScene, ReadsGlobalsCameraAndFilm) {
    const FullScene full;
    const SceneDescription& scene = full.scene;
    EXPECT_EQ(scene.file, full.folder.path() + "/scene.toml");
    EXPECT_EQ(scene.globals.number("fps"), 25);
    EXPECT_EQ(scene.globals.vec2("frames"), Vec2d(1, 100));
    EXPECT_EQ(scene.globals.number("bind_frame"), -2.5);
    EXPECT_EQ(scene.globals.number("tolerance_pixels"), 0.25);
    EXPECT_EQ(scene.globals.number("tolerance"), 0.001);
    EXPECT_FALSE(scene.globals.at("tolerance").given);
    EXPECT_EQ(scene.camera.vec3("position"), Vec3d(0, 1, 5));
    EXPECT_EQ(scene.camera.vec2("shutter"), Vec2d(-0.25, 0.25));
    EXPECT_EQ(scene.camera.number("focus"), 4);
    EXPECT_EQ(scene.film.vec2("size"), Vec2d(320, 180));
    EXPECT_EQ(scene.film.integer("samples"), 16);
    EXPECT_EQ(scene.film.text("filter"), "gaussian");
    EXPECT_EQ(scene.film.at("aovs").texts, (std::vector<std::string>{"depth", "normal"}));
    EXPECT_EQ(scene.film.integer("motion_keys"), 4);
}

TEST(LoadScene, ReadsNestedTablesAndRamps) {
    const FullScene full;
    const ParamSet& wind = full.scene.wind;
    EXPECT_EQ(wind.number("noise.frequency"), 2);
    EXPECT_TRUE(wind.at("noise.frequency").given);
    EXPECT_EQ(wind.integer("noise.octaves"), 3);
    EXPECT_FALSE(wind.at("noise.octaves").given);
    EXPECT_EQ(wind.at("ramp_rotate").numbers, (Numbers{0, 0, 0.5, 0.2, 1, 1}));
    EXPECT_EQ(wind.text("ramp_rotate"), "smooth");
    EXPECT_FALSE(wind.has("gusts"));
    const ParamSet& grass = full.scene.procedurals.at(0).params;
    EXPECT_EQ(grass.number("wind.speed"), 7);
    EXPECT_EQ(grass.integer("wind.noise.octaves"), 2);
    EXPECT_FALSE(grass.has("wind.direction"));
    EXPECT_EQ(grass.vec2("length"), Vec2d(0.3, 0.3));
    EXPECT_EQ(grass.text("label"), "a 'bare' word");
    EXPECT_EQ(grass.text("on"), "hill");
}

TEST(LoadScene, AcceptsEveryWayToWriteANestedTable) {
    const Schema schema = test_schema();
    const Folder folder;
    for (const char* text : {"[wind.noise]\nfrequency = 5\n", "[wind]\nnoise = { frequency = 5 }\n",
                             "[wind]\nnoise.frequency = 5\n", "[wind]\n\"noise.frequency\" = 5\n"}) {
        const SceneDescription scene = load_scene(folder.write("a.toml", small_scene + text), {}, schema);
        EXPECT_EQ(scene.wind.number("noise.frequency"), 5) << text;
    }
    const std::string twice = small_scene + "[wind]\nnoise.frequency = 5\n\"noise.frequency\" = 5\n";
    const auto lines = mistakes(folder.write("b.toml", twice), {}, schema);
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("wind.noise.frequency is given twice"), std::string::npos);
}

TEST(LoadScene, ReadsThingsInOrder) {
    const FullScene full;
    const SceneDescription& scene = full.scene;
    ASSERT_EQ(scene.lights.size(), 4u);
    EXPECT_EQ(scene.lights[0].name, "sun");
    EXPECT_EQ(scene.lights[0].params.vec3("irradiance"), Vec3d(4, 4, 4));
    EXPECT_EQ(scene.lights[1].name, "");
    EXPECT_EQ(scene.lights[2].params.text("file"), full.folder.path() + "/sky.exr");
    EXPECT_EQ(scene.lights[3].type, "mesh");
    ASSERT_EQ(scene.materials.size(), 2u);
    EXPECT_EQ(scene.materials[0].params.vec3("base"), Vec3d(0.3, 0.2, 0.1));
    EXPECT_EQ(scene.materials[1].type, "hair");
    ASSERT_EQ(scene.meshes.size(), 2u);
    EXPECT_EQ(scene.meshes[0].params.text("file"), full.folder.path() + "/mesh.obj");
    EXPECT_FALSE(scene.meshes[0].params.boolean("smooth"));
    const auto before = full_scene.begin() + static_cast<std::ptrdiff_t>(full_scene.find("[[mesh]]"));
    EXPECT_EQ(scene.meshes[0].place.line, 1 + std::count(full_scene.begin(), before, '\n'));
    EXPECT_EQ(scene.meshes[0].place.column, 1);
    ASSERT_EQ(scene.procedurals.size(), 1u);
}

TEST(LoadScene, ReadsTransforms) {
    const FullScene full;
    const ParamValue& still = full.scene.meshes[0].params.at("transform");
    EXPECT_EQ(still.numbers, (Numbers{0, 1, 2, 3, 0, 0, 0, 2, 2, 2}));
    const ParamValue& moving = full.scene.meshes[1].params.at("transform");
    EXPECT_EQ(moving.numbers, (Numbers{1, 0, 0, 0, 0, 90, 0, 1, 1, 1, 2.5, 0, 0, 0, 0, 0, 0, 1, -1, 1}));
    EXPECT_EQ(moving.text, "smooth");
}

TEST(LoadScene, NeedsNoMoreThanACamera) {
    const Schema schema = test_schema();
    const Folder folder;
    const std::string plane = "[[mesh]]\nname = \"p\"\ntype = \"plane\"\n";
    const SceneDescription scene = load_scene(folder.write("a.toml", small_scene + plane), {}, schema);
    EXPECT_EQ(scene.meshes[0].params.at("transform").numbers, (Numbers{0, 0, 0, 0, 0, 0, 0, 1, 1, 1}));
    EXPECT_FALSE(scene.meshes[0].params.has("material"));
    EXPECT_EQ(scene.camera.vec3("up"), Vec3d(0, 1, 0));
    EXPECT_EQ(scene.globals.vec2("frames"), Vec2d(1, 1));
    EXPECT_TRUE(scene.film.at("aovs").texts.empty());
    EXPECT_EQ(scene.film.at("size").place.line, 1); // of the table that the file lacks
    EXPECT_TRUE(scene.lights.empty());
}

TEST(LoadScene, ReadsWindowsLinesAndByteOrderMarks) {
    const Schema schema = test_schema();
    const Folder folder;
    const std::string file =
        folder.write("a.toml", "\xEF\xBB\xBF"
                               "[camera]\r\nposition = [0, 1, 5]\r\ntarget = [0, 0, 0]\r\n");
    EXPECT_EQ(load_scene(file, {}, schema).camera.vec3("position"), Vec3d(0, 1, 5));
}

TEST(LoadScene, IsFreeOfScaleInTheCamera) {
    const Schema schema = test_schema();
    const Folder folder;
    for (const char* target : {"[0, 0.000001, 0]", "[99999999, 0, 0]"}) {
        const std::string text =
            std::string("[camera]\nposition = [0, 0, 0]\nup = [0, 0, 1]\ntarget = ") + target;
        EXPECT_TRUE(mistakes(folder.write("a.toml", text), {}, schema).empty()) << target;
    }
    const std::string far = "[camera]\nposition = [10000000, 0, 0]\ntarget = [10000000, 0, 0.001]\n";
    EXPECT_TRUE(mistakes(folder.write("a.toml", far), {}, schema).empty());
}

TEST(LoadScene, FindsRelativeFilesNextToTheScene) {
    const Schema schema = test_schema();
    const Folder folder;
    std::filesystem::create_directory(folder.path() + "/meshes");
    folder.write("meshes/stone.obj", "");
    const std::string text =
        small_scene + "[[mesh]]\nname = \"s\"\ntype = \"file\"\nfile = \"meshes/ston.obj\"\n";
    const std::string file = folder.write("a.toml", text);
    const auto lines = mistakes(file, {}, schema);
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("did you mean \"stone.obj\"?"), std::string::npos) << lines[0];
    const SceneDescription scene = load_scene(file, {"mesh.s.file=meshes/stone.obj"}, schema);
    EXPECT_EQ(scene.meshes[0].params.text("file"), folder.path() + "/meshes/stone.obj");
}

TEST(LoadScene, RefusesWhatIsNoSceneFile) {
    const Schema schema = test_schema();
    const Folder folder;
    auto expect = [&](const std::string& file, const std::string& place, const std::string& words) {
        const auto lines = mistakes(file, {}, schema);
        ASSERT_EQ(lines.size(), 1u) << file;
        EXPECT_EQ(lines[0].find(file + place + ": "), 0u) << lines[0];
        EXPECT_NE(lines[0].find(words), std::string::npos) << lines[0];
    };
    expect(folder.path() + "/absent.toml", "", "there is no such scene file: check the path");
    expect(folder.path(), "", "this is a directory: name a scene file in it");
    expect(folder.write("empty.toml", ""), ":1:1", "the scene file is empty");
    expect(folder.write("blank.toml", " \r\n\t\n"), ":1:1", "the scene file is empty");
    expect(folder.write("latin.toml", "[camera]\nname = \"\xE9t\xE9\"\n"), ":2:8", "save the file as UTF-8");
    expect(folder.path() + "/" + std::string(300, 'x'), "", "cannot be opened");
    const std::string big = folder.write("big.toml", "");
    std::filesystem::resize_file(big, (64 << 20) + 1);
    expect(big, "", "larger than 64 MB");
}

TEST(LoadScene, SurvivesDepthAndLength) {
    const Schema schema = test_schema();
    const Folder folder;
    std::string dots = "a", nested = "a = ", tables;
    for (int i = 0; i < 100000; ++i) dots += i % 2 ? ".a" : ".\"a.,\"";
    for (int i = 0; i < 250; ++i) nested += "{ a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a = ";
    nested += "1" + std::string(250, '}');
    for (int i = 0; i < 5000; ++i) tables += "[[mesh]]\nname = 1\n";
    const std::string numbers = "frames = [" + std::string(400000, '1') + "]\n";
    for (const std::string& text :
         {dots + " = 1", "[" + dots + "]", nested, "a = " + std::string(100000, '['),
          "fps = " + std::string(100000, '{'), tables, numbers, std::string(100000, 'k') + " = 1",
          "a = \"" + std::string(100000, 'k') + "\""})
        EXPECT_FALSE(mistakes(folder.write("a.toml", text), {}, schema).empty());
    // Dots in texts and comments are no keys.
    const std::string prose = "# a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r.s.t.u.v.w.x.y.z\n" + small_scene;
    EXPECT_TRUE(mistakes(folder.write("a.toml", prose), {}, schema).empty());
}

TEST(LoadScene, AcceptsAllDefaults) {
    // Every spec that core/scene declares has a default that passes its own checks, or none.
    Schema schema = scene_schema();
    std::vector<ParamSpec> all;
    auto add = [&](std::vector<ParamSpec> specs, const std::string& prefix) {
        for (ParamSpec& spec : specs) {
            EXPECT_FALSE(spec.help.empty()) << spec.name;
            EXPECT_LE(spec.minimum, spec.maximum) << spec.name;
            if (spec.initial.empty()) continue;
            spec.name = prefix + spec.name;
            all.push_back(std::move(spec));
        }
    };
    add(schema.globals, "");
    add(schema.camera, "");
    add(schema.film, "");
    for (const auto* types : {&schema.lights, &schema.meshes})
        for (const ItemSchema& type : *types) add(type.params, type.type + "_");
    schema.wind = all; // read as one table of defaults
    const Folder folder;
    const auto lines = mistakes(folder.write("a.toml", small_scene), {}, schema);
    EXPECT_TRUE(lines.empty()) << lines.front();
    EXPECT_GT(all.size(), 40u);
}

TEST(LoadScene, ReportsTheBadDefaultOfALibrary) {
    Schema schema = scene_schema();
    schema.wind = {{"speed", ParamType::number, "", "fast", 0, 1, "", ""},
                   {"calm", ParamType::number, "", "2", 0, 1, "", ""}};
    const Folder folder;
    const auto lines = mistakes(folder.write("a.toml", small_scene), {}, schema);
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_NE(lines[0].find("the default of wind.speed, \"fast\", is no valid value"), std::string::npos);
}

TEST(LoadScene, KeepsIntegersWithin32Bits) {
    Schema schema = scene_schema();
    constexpr double any = std::numeric_limits<double>::infinity();
    schema.wind = {{"seed", ParamType::integer, "", "0", -any, any, "", "any"}};
    const Folder folder;
    const std::string file = folder.write("a.toml", small_scene);
    EXPECT_EQ(load_scene(file, {"wind.seed=-2147483648"}, schema).wind.integer("seed"), -2147483647 - 1);
    const auto lines = mistakes(file, {"wind.seed=2147483648"}, schema);
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("wind.seed is 2147483648, which no 32-bit integer can hold"), std::string::npos);
}

TEST(LoadScene, DoesNotWaitForAPipe) {
    const Schema schema = test_schema();
    const Folder folder;
    ASSERT_EQ(mkfifo((folder.path() + "/pipe.obj").c_str(), 0600), 0);
    const std::string mesh = "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"pipe.obj\"\n";
    const auto lines = mistakes(folder.write("a.toml", small_scene + mesh), {}, schema);
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("is no file but a pipe or device"), std::string::npos) << lines[0];
}

TEST(SceneLibraries, NamesEachOnce) {
    const Folder folder;
    const std::string file =
        folder.write("a.toml", "[[procedural]]\nlibrary = \"x.so\"\n[[procedural]]\n[[procedural]]\n"
                               "name = \"p\"\nlibrary = \"x.so\"\n");
    auto libraries = scene_libraries(file, {});
    ASSERT_EQ(libraries.size(), 1u);
    EXPECT_EQ(libraries[0].path, folder.path() + "/x.so");
    EXPECT_EQ(libraries[0].place.line, 2);
    libraries = scene_libraries(file, {"procedural.p.library=/y.so"});
    ASSERT_EQ(libraries.size(), 2u);
    EXPECT_EQ(libraries[1].path, "/y.so");
}

} // namespace
} // namespace marram
