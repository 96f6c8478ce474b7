// SPDX-License-Identifier: Apache-2.0
// --set key=value works for any key, and errors name the setting.
#include "scene_test.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

struct Settings : testing::Test {
    Schema schema = test_schema();
    Folder folder;
    std::string file;
    Settings() {
        folder.write("mesh.obj", "");
        folder.write("other.obj", "");
        folder.write("sky.exr", "");
        file = folder.write("scene.toml", full_scene);
    }
    // Expects exactly one mistake, which starts with `line`.
    void expect(const std::vector<std::string>& settings, const std::string& line) {
        const auto lines = mistakes(file, settings, schema);
        ASSERT_EQ(lines.size(), 1u) << (lines.empty() ? "no mistake" : lines.back()) << " / " << line;
        EXPECT_EQ(lines[0].find(line), 0u) << lines[0] << "\n  expected " << line;
    }
};

TEST_F(Settings, ReachEveryKey) {
    const std::vector<std::string> settings = {"fps=30",
                                               " film.samples = 4 ",
                                               "film.filter=box",
                                               "wind.noise.frequency=7",
                                               "light.sun.angle=2",
                                               "material.soil.base=[0.5, 0.25, 0]",
                                               "mesh.hill.file=other.obj",
                                               "mesh.hill.transform={ scale = 3 }",
                                               "mesh.lamp.001.radius=9",
                                               "procedural.grass.wind.speed=3",
                                               "procedural.grass.wind.noise.octaves=5",
                                               "procedural.grass.length=[0.2, 0.3]"};
    const SceneDescription scene = load_scene(file, settings, schema);
    EXPECT_EQ(scene.globals.number("fps"), 30);
    EXPECT_EQ(scene.film.integer("samples"), 4);
    EXPECT_EQ(scene.film.text("filter"), "box");
    EXPECT_EQ(scene.wind.number("noise.frequency"), 7);
    EXPECT_EQ(scene.lights[0].params.number("angle"), 2);
    EXPECT_EQ(scene.materials[0].params.vec3("base"), Vec3d(0.5, 0.25, 0));
    EXPECT_EQ(scene.meshes[0].params.text("file"), folder.path() + "/other.obj");
    EXPECT_EQ(scene.meshes[0].params.at("transform").numbers[7], 3);
    EXPECT_EQ(scene.meshes[0].params.at("transform").numbers[1], 0); // replaced completely
    EXPECT_EQ(scene.meshes[1].params.number("radius"), 9);
    const ParamSet& grass = scene.procedurals[0].params;
    EXPECT_EQ(grass.number("wind.speed"), 3);
    EXPECT_EQ(grass.integer("wind.noise.octaves"), 5);
    EXPECT_EQ(grass.vec2("length"), Vec2d(0.2, 0.3));
    EXPECT_EQ(grass.at("length").place.file, "--set procedural.grass.length=[0.2, 0.3]");
    EXPECT_EQ(grass.at("length").place.line, 0);
}

TEST_F(Settings, ReplaceAListOfTables) {
    const SceneDescription scene = load_scene(file,
                                              {"wind.gusts.control=[{ strength = 3 }, { shape = \"box\" }]",
                                               "procedural.grass.wind.gusts.control=[]"},
                                              schema);
    EXPECT_EQ(scene.wind.find_list("gusts.control")->size, 2u);
    EXPECT_EQ(scene.wind.number("gusts.control[0].strength"), 3);
    EXPECT_EQ(scene.wind.text("gusts.control[1].shape"), "box");
    const ParamSet& grass = scene.procedurals[0].params;
    ASSERT_NE(grass.find_list("wind.gusts.control"), nullptr);
    EXPECT_EQ(grass.find_list("wind.gusts.control")->size, 0u);
}

TEST_F(Settings, ReachElementsOfLists) {
    const SceneDescription scene =
        load_scene(file,
                   {"wind.gusts.control=[{ strength = 3 }, { shape = \"box\" }]",
                    "wind.gusts.control[1].strength=-2", "wind.gusts.control[0]={ strength = 5 }",
                    "procedural.grass.length=[0.2, 0.3]", "procedural.grass.length[1]=0.7"},
                   schema);
    EXPECT_EQ(scene.wind.find_list("gusts.control")->size, 2u);
    EXPECT_EQ(scene.wind.number("gusts.control[0].strength"), 5);
    EXPECT_EQ(scene.wind.number("gusts.control[1].strength"), -2);
    EXPECT_EQ(scene.wind.text("gusts.control[1].shape"), "box");
    EXPECT_EQ(scene.wind.at("gusts.control[1].strength").place.file,
              "--set wind.gusts.control[1].strength=-2");
    EXPECT_EQ(scene.procedurals[0].params.vec2("length"), Vec2d(0.2, 0.7));
}

TEST_F(Settings, ReachNamedElementsOfLists) {
    constexpr double any = std::numeric_limits<double>::infinity();
    const ParamSpec name = {"name", ParamType::text, "", "none", -any, any, "", "its name"};
    const ParamSpec height = {"height", ParamType::number, "m", "1", 0, 100, "", "height"};
    schema.procedurals.push_back(
        {"desert",
         "sand",
         {},
         {{"layer",
           {{"noise", "bumps", {name, height}}, {"dune", "a dune", {name, height}}},
           {"type", ParamType::choice, "", "", -any, any, "noise|dune", "its type"}}}});
    file = folder.write("desert.toml", small_scene +
                                           "\n[[procedural]]\ntype = \"desert\"\nname = \"sea\"\n"
                                           "[[procedural.layer]]\ntype = \"noise\"\n"
                                           "[[procedural.layer]]\ntype = \"dune\"\nname = \"crest\"\n"
                                           "[[procedural.layer]]\ntype = \"dune\"\nname = \"crest.b\"\n");
    const SceneDescription scene =
        load_scene(file,
                   {"procedural.sea.layer.crest.height=5", "procedural.sea.layer.crest.b.height=6",
                    "procedural.sea.layer.noise.height=7"},
                   schema);
    const ParamSet& sea = scene.procedurals.back().params;
    EXPECT_EQ(sea.number("layer[0].height"), 7) << "without a name it has that of its type";
    EXPECT_EQ(sea.number("layer[1].height"), 5);
    EXPECT_EQ(sea.number("layer[2].height"), 6);
    expect(
        {"procedural.sea.layer.crst.height=5"},
        "--set procedural.sea.layer.crst.height=5: no element of procedural.sea.layer is named \"crst\": did "
        "you mean \"crest\"?, or write procedural.sea.layer[0] for its first element");
    expect({"procedural.sea.layer.crest.b=5"},
           "--set procedural.sea.layer.crest.b=5: procedural.sea.layer.crest.b is an element of a list: add "
           "one of its keys");
    file = folder.write("names.toml", small_scene +
                                          "\n[[procedural]]\ntype = \"desert\"\nname = \"sea\"\n"
                                          "[[procedural.layer]]\ntype = \"noise\"\n"
                                          "[[procedural.layer]]\ntype = \"dune\"\n"
                                          "[[procedural.layer]]\ntype = \"dune\"\n"
                                          "[[procedural.layer]]\ntype = \"noise\"\nname = \"noise\"\n");
    const SceneDescription named = load_scene(file, {"procedural.sea.layer.noise.height=7"}, schema);
    EXPECT_EQ(named.procedurals.back().params.number("layer[3].height"), 7) << "names win over types";
    EXPECT_EQ(named.procedurals.back().params.number("layer[0].height"), 1);
    expect({"procedural.sea.layer.dune.height=5"},
           "--set procedural.sea.layer.dune.height=5: 2 elements of procedural.sea.layer have the type "
           "\"dune\": "
           "write procedural.sea.layer[1] or procedural.sea.layer[2]");
}

TEST_F(Settings, AddTablesAndTheLastOneCounts) {
    file = folder.write("small.toml", small_scene);
    const SceneDescription scene =
        load_scene(file, {"film.samples=4", "wind.noise.octaves=2", "film.samples=8"}, schema);
    EXPECT_EQ(scene.film.integer("samples"), 8);
    EXPECT_EQ(scene.wind.integer("noise.octaves"), 2);
}

TEST_F(Settings, MendAMistakeOfTheFile) {
    file = folder.write("small.toml", "fps = \"a\"\n" + small_scene);
    EXPECT_EQ(mistakes(file, {}, schema).size(), 1u);
    EXPECT_EQ(load_scene(file, {"fps=30"}, schema).globals.number("fps"), 30);
}

TEST_F(Settings, ExplainTheirMistakes) {
    expect({"film.samples"}, "--set film.samples: there is no value: write key=value");
    expect({"=4"}, "--set =4: \"\" is no key");
    expect({"film..samples=4"}, "--set film..samples=4: \"film..samples\" is no key");
    expect({"wind.speed=x"},
           "--set wind.speed=x: wind.speed is the text \"x\": give a number from 0 to 100 m/s");
    expect({"wind.speed=nan"}, "--set wind.speed=nan: wind.speed is nan");
    expect({"wind.speed="}, "--set wind.speed=: wind.speed is the text \"\"");
    expect({"wind.sped=1"}, "--set wind.sped=1: wind.sped is unknown: did you mean \"speed\"?");
    expect({"flim.samples=1"}, "--set flim.samples=1: flim is unknown: did you mean \"film\"?");
    expect(
        {"film.size.x=1"},
        "--set film.size.x=1: film.size is no table: write film.size[0] for its first element, or set it as "
        "a whole");
    expect({"mesh.hil.file=x.obj"},
           "--set mesh.hil.file=x.obj: no mesh is named \"hil\": did you mean \"hill\"?");
    expect({"mesh.hill=3"},
           "--set mesh.hill=3: \"mesh.hill\" has no name and key: write mesh.NAME.KEY=value");
    expect({"mesh=3"}, "--set mesh=3: \"mesh\" has no name and key");
    expect({"mesh.hill.file=x.obj"},
           "--set mesh.hill.file=x.obj: mesh.hill.file: there is no file \"x.obj\"");
    expect({"wind.shielding.shield=1"},
           "--set wind.shielding.shield=1: wind: shielding is not available in this build");
    expect(
        {"wind.gusts.control=[{ strength = 99 }]"},
        "--set wind.gusts.control=[{ strength = 99 }]: wind.gusts.control[0].strength is 99: give a number "
        "from -10 to 10");
    expect({"wind.gusts.control=[{ strenght = 1 }]"},
           "--set wind.gusts.control=[{ strenght = 1 }]: wind.gusts.control[0].strenght is unknown: did you "
           "mean \"strength\"?");
    expect({"wind.gusts.control=[]", "wind.gusts.control.strength=1"},
           "--set wind.gusts.control.strength=1: wind.gusts.control is no table: write "
           "wind.gusts.control[0] for its first element");
    expect(
        {"wind.gusts.control=[]", "wind.gusts.control[0].strength=1"},
        "--set wind.gusts.control[0].strength=1: wind.gusts.control has 0 elements, there is no [0]: set the "
        "list as a whole");
    expect({"film.size[2]=1"},
           "--set film.size[2]=1: film.size has 2 elements, there is no [2]: give 0 to 1");
    expect(
        {"film.none[0].size=1"},
        "--set film.none[0].size=1: film.none has no elements here: set it as a whole: film.none=[{ ... }]");
    expect({"fps[0]=1"}, "--set fps[0]=1: fps is no list: leave out the number in brackets");
    for (const std::string odd : {"film.size[", "film.size[]", "film.size[-1]", "film.size[0",
                                  "film.size[1]x", "film.[0]", "film.size[99999999999999999999]"})
        expect({odd + "=1"}, "--set " + odd + "=1: \"" + odd + "\" is no key");
    expect({"fps=30\nx=1"}, "--set fps=30?x=1: fps is the text");
    expect({"fps=\xff"}, "--set fps=\xff: the value is no UTF-8");
    expect({"camera=3"}, "--set camera=3: camera is 3: write a table [camera]");
}

TEST_F(Settings, OfAThingThatTheSceneLacks) {
    file = folder.write("small.toml", small_scene);
    expect({"material.m.base=1"},
           "--set material.m.base=1: no material is named \"m\": there is no material with a name");
    file = folder.write("odd.toml", small_scene + "[material]\nname = \"m\"\n");
    EXPECT_EQ(mistakes(file, {"material.m.base=1"}, schema).size(), 2u);
}

TEST_F(Settings, ReachNamesWithEqualsSigns) {
    file = folder.write("small.toml", small_scene +
                                          "[[mesh]]\nname = \"a=b\"\ntype = \"file\"\nfile = \"mesh.obj\"\n"
                                          "[[mesh]]\nname = \"a\"\ntype = \"file\"\nfile = \"mesh.obj\"\n");
    const SceneDescription scene = load_scene(file, {"mesh.a=b.file=other.obj"}, schema);
    EXPECT_EQ(scene.meshes[0].params.text("file"), folder.path() + "/other.obj");
    EXPECT_EQ(scene.meshes[1].params.text("file"), folder.path() + "/mesh.obj");
    expect({"mesh.a=b"}, "--set mesh.a=b: \"mesh.a\" has no name and key");
}

TEST_F(Settings, ComeAfterTheMistakesOfTheFile) {
    file = folder.write("small.toml", small_scene + "[film]\nsamples = 0\nsize = 3\n");
    const auto lines = mistakes(file, {"wind.speed=x", "fps=y"}, schema);
    ASSERT_EQ(lines.size(), 4u);
    EXPECT_EQ(lines[0].find(file + ":5:11: film.samples is 0"), 0u) << lines[0];
    EXPECT_EQ(lines[1].find(file + ":6:8: film.size is 3"), 0u) << lines[1];
    EXPECT_EQ(lines[2].find("--set "), 0u);
}

TEST_F(Settings, CannotBeNestedToDeath) {
    std::string dots = "a";
    for (int i = 0; i < 50000; ++i) dots += ".a";
    for (const std::string& setting : {dots + "=1", "fps={" + dots + "=1}", "fps=" + std::string(50000, '[')})
        EXPECT_EQ(mistakes(file, {setting}, schema).size(), 1u);
}

} // namespace
} // namespace marram
