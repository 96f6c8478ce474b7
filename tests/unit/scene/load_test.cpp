// SPDX-License-Identifier: Apache-2.0
// Good scenes are read completely; files that are not scenes are rejected with one clear line.
#include "core/scene/libraries.h"
#include "scene_test.h"

#include <algorithm>
#include <gtest/gtest.h>
#include <sys/stat.h>

namespace marram {
namespace {

using Numbers = std::vector<double>;

// The description points into the schema, so the schema must outlive it.
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
    EXPECT_FALSE(wind.has("shielding"));
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

TEST(LoadScene, ReadsListsOfTables) {
    const Schema schema = test_schema();
    const Folder folder;
    const std::string plain = small_scene + "[wind]\nspeed = 2\n";
    const std::string nested = "[wind.gusts]\nnum_gusts = 2\n[[wind.gusts.control]]\nshape = \"box\"\n"
                               "inner = [0, 0.5, 1]\n[[wind.gusts.control]]\n[wind.gusts.control.transform]\n"
                               "scale = 3\n";
    const std::string inlined =
        "gusts = { num_gusts = 2, control = [{ shape = \"box\", inner = [0, 0.5, 1] },\n"
        "{ transform = { scale = 3 } }] }\n";
    for (const std::string& text : {nested, inlined}) {
        const ParamSet wind = load_scene(folder.write("a.toml", plain + text), {}, schema).wind;
        ASSERT_NE(wind.find_list("gusts.control"), nullptr) << text;
        EXPECT_EQ(wind.find_list("gusts.control")->size, 2u);
        EXPECT_EQ(wind.integer("gusts.num_gusts"), 2);
        EXPECT_EQ(wind.text("gusts.control[0].shape"), "box");
        EXPECT_EQ(wind.vec3("gusts.control[0].inner"), Vec3d(0, 0.5, 1));
        EXPECT_FALSE(wind.at("gusts.control[0].strength").given);
        EXPECT_EQ(wind.number("gusts.control[0].strength"), 1);
        EXPECT_EQ(wind.text("gusts.control[1].shape"), "sphere");
        EXPECT_FALSE(wind.has("gusts.control[1].inner"));
        EXPECT_EQ(wind.at("gusts.control[1].transform").numbers, (Numbers{0, 0, 0, 0, 0, 0, 0, 3, 3, 3}));
        EXPECT_FALSE(wind.has("gusts.control[2].shape"));
        EXPECT_FALSE(wind.has("gusts.control[].shape"));
        EXPECT_EQ(wind.at("gusts.control[0].shape").place.line, text == nested ? 9 : 6);
        // A parameter that an element omits has the element's location.
        EXPECT_EQ(wind.at("gusts.control[1].strength").place.line, text == nested ? 11 : 7);
    }
    const ParamSet absent = load_scene(folder.write("b.toml", plain), {}, schema).wind;
    EXPECT_EQ(absent.find_list("gusts.control"), nullptr);
    EXPECT_FALSE(absent.has("gusts.control[0].shape"));
    const ParamSet empty =
        load_scene(folder.write("c.toml", plain + "gusts.control = []\n"), {}, schema).wind;
    ASSERT_NE(empty.find_list("gusts.control"), nullptr);
    EXPECT_EQ(empty.find_list("gusts.control")->size, 0u);
}

TEST(LoadScene, ReportsMistakesInListsOfTables) {
    Schema schema = test_schema();
    constexpr double any = std::numeric_limits<double>::infinity();
    schema.wind = {{"a.list[].needed", ParamType::number, "m", "", 0, 1, "", "how much"},
                   {"a.list[].deep.mesh", ParamType::reference, "", "none", -any, any, "mesh", "which"}};
    const Folder folder;
    auto expect = [&](const std::string& text, const std::string& place, const std::string& words) {
        const std::string file = folder.write("a.toml", small_scene + "[wind]\n" + text);
        const auto lines = mistakes(file, {}, schema);
        ASSERT_EQ(lines.size(), 1u) << text;
        EXPECT_EQ(lines[0].find(file + place + ": " + words), 0u) << lines[0] << "\n  expected " << words;
    };
    expect("a.list = [{ needed = 1 }, {}]\n", ":5:27",
           "wind.a.list[1].needed is missing: add needed = ... (how much; a number from 0 to 1 m)");
    expect("[[wind.a.list]]\nneeded = 0\n[[wind.a.list]]\n", ":7:1", "wind.a.list[1].needed is missing");
    expect("a.list = [{ needed = 0.5, deep.mesh = \"x\" }]\n", ":5:39",
           "wind.a.list[0].deep.mesh: there is no mesh \"x\"");
    expect("a.list = [{ needed = 0.5, deep.mash = 1 }]\n", ":5:32",
           "wind.a.list[0].deep.mash is unknown: did you mean \"mesh\"?");
    expect("a.list = [{ needed = 0.5, mesh = 1 }]\n", ":5:27",
           "wind.a.list[0].mesh is unknown: did you mean \"deep.mesh\"?");
    expect("a.needed = 1\n", ":5:3", "wind.a.needed is unknown: did you mean \"list[].needed\"?");
    expect("a.lisst = []\n", ":5:3", "wind.a.lisst is unknown: did you mean \"list\"?");
    expect("a.\"list[]\" = {}\n", ":5:3", "wind.a.list[] is unknown: did you mean \"list\"?");
    expect("\"a.list[].needed\" = 1\n", ":5:1", "wind.a.list[].needed is unknown");
    expect("a.list = [[]]\n", ":5:11", "wind.a.list[0] is an empty list: give a table, { ... }");
    expect("a.list = []\n\"a.list\" = []\n", ":6:1", "wind.a.list is given twice: remove one of them");
    expect("a = [{}]\n", ":5:5", "wind.a is a list of 1: give a table");
    expect("a = {}\n", ":5:5", "wind.a is an empty table, which changes nothing: give a key in it");
    expect("[wind.a]\n", ":5:1", "wind.a is an empty table, which changes nothing: give a key in it");
    // With --set an empty table removes what the file gives.
    const std::string file = folder.write("b.toml", small_scene + "[wind]\na.list = [{ needed = 0.5 }]\n");
    EXPECT_EQ(load_scene(file, {}, schema).wind.find_list("a.list")->size, 1U);
    EXPECT_EQ(load_scene(file, {"wind.a={}"}, schema).wind.find_list("a.list"), nullptr);
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
    EXPECT_EQ(scene.film.at("size").place.line, 1); // the table is missing: line 1 of the file
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

TEST(LoadScene, FindsAMisspeltType) {
    const Folder folder;
    const auto lines = mistakes(
        folder.write("a.toml", small_scene + "[[mesh]]\nname = \"s\"\ntyp = \"plane\"\n"), {}, test_schema());
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("mesh.s has no type: write type in place of \"typ\""), std::string::npos)
        << lines[0];
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
    // Dots in strings and comments are not key separators.
    const std::string prose = "# a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r.s.t.u.v.w.x.y.z\n" + small_scene;
    EXPECT_TRUE(mistakes(folder.write("a.toml", prose), {}, schema).empty());
}

TEST(LoadScene, AcceptsAllDefaults) {
    // Every spec that core/scene declares either has no default or one that passes its own checks.
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
    schema.wind = all; // all as one table of defaults
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

// Search order: the folder of the scene, then the folders of MARRAM_PLUGIN_PATH in order. A path with a
// folder is used as it is.
TEST(SceneLibraries, AreLookedForInTheSearchPath) {
    const Folder scene, first, second;
    const auto found = [&](const char* name) { return library_path(scene.path(), name); };
    ASSERT_EQ(setenv("MARRAM_PLUGIN_PATH", (first.path() + "::/nowhere:" + second.path()).c_str(), 1), 0);
    EXPECT_EQ(found("x.so"), scene.path() + "/x.so"); // found nowhere: the scene's folder is returned
    second.write("x.so", "");
    EXPECT_EQ(found("x.so"), second.path() + "/x.so");
    first.write("x.so", "");
    EXPECT_EQ(found("x.so"), first.path() + "/x.so");
    EXPECT_EQ(found("./x.so"), scene.path() + "/./x.so");
    const auto libraries = scene_libraries(scene.write("a.toml", "[[procedural]]\nlibrary = \"x.so\"\n"), {});
    ASSERT_EQ(libraries.size(), 1u);
    EXPECT_EQ(libraries[0].path, first.path() + "/x.so");
    scene.write("x.so", "");
    EXPECT_EQ(found("x.so"), scene.path() + "/x.so");
    const std::vector<std::string> folders = plugin_folders();
    ASSERT_EQ(folders.size(), 5u); // the three, the program's own, and its installed folder
    EXPECT_EQ(folders[0], first.path());
    EXPECT_EQ(folders[2], second.path());
    EXPECT_TRUE(folders[4].ends_with("/marram")) << folders[4];
    unsetenv("MARRAM_PLUGIN_PATH");
    EXPECT_EQ(plugin_folders().size(), 2u);
}

} // namespace
} // namespace marram
