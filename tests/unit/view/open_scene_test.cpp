// SPDX-License-Identifier: Apache-2.0
#include "core/view/open_scene.h"

#include "core/scene/value_text.h"
#include "core/shot/settings.h"
#include "core/view/handles.h"
#include "core/view/shown_wind.h"
#include "core/world/build.h"

#include <gtest/gtest.h>

#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <thread>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr const char* scene_text = R"(# A head of hair.
fps = 24
frames = [1, 24]
tolerance = 0.001

[camera]
position = [0, 1, 4]   # in front
target = [0, 0, 0]

[wind]
speed = 6              # m/s
noise.amplitude = 0.4
jiggle = { frequency = 3, damping = 0.3 }

[[material]]
name = "hair"
type = "hair"
color = [0.4, 0.2, 0.1]

[[mesh]]
name = "ball"
type = "sphere"
radius = 0.5

[[procedural]]
name = "fur"
type = "groom"
on = "ball"
count = 200
length = 0.2
width = 0.002
material = "hair"
)";

std::string read(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

class OpenSceneTest : public ::testing::Test {
  protected:
    OpenSceneTest() {
        std::string name = (fs::temp_directory_path() / "marram_view_XXXXXX").string();
        folder = ::mkdtemp(name.data());
        file = (folder / "ball.toml").string();
        write(scene_text);
    }
    ~OpenSceneTest() override {
        std::error_code ignored;
        fs::remove_all(folder, ignored);
    }
    void write(const std::string& text) const { std::ofstream(file, std::ios::binary) << text; }

    // All vertices of the strands at a frame.
    static std::vector<float> strands(Shot& shot, double frame) {
        static const std::atomic<bool> never{false};
        set_frame(shot, frame);
        BuildSettings settings = build_settings(shot, frame);
        settings.shutter_open = settings.shutter_close = 0.0;
        settings.trace_curves = false;
        BuildProgress progress;
        BuildStats stats;
        const World world = build_world(shot.geometry, settings, never, progress, stats);
        std::vector<float> all;
        for (const CurveGeometry& curves : world.curves)
            all.insert(all.end(), curves.vertices[0],
                       curves.vertices[0] + 4 * curves.layout().vertex_count());
        return all;
    }
    std::vector<float> strands_with(const std::vector<std::string>& settings, double frame) const {
        static const std::atomic<bool> never{false};
        Overrides overrides;
        overrides.settings = settings;
        Shot shot = load_shot(file, overrides, never);
        return strands(shot, frame);
    }

    // Looks until writing is over.
    static bool files_changed(OpenScene& scene) {
        const bool before = scene.files_changed();
        return scene.files_changed() || before;
    }

    fs::path folder;
    std::string file;
    std::atomic<bool> stop{false};
};

TEST_F(OpenSceneTest, ChangesGiveTheBitsOfAFreshScene) {
    OpenScene scene(file, {}, stop);
    scene.load();
    const Shot* const loaded = scene.shot();
    const std::vector<float> before = strands(*scene.shot(), 7);
    EXPECT_EQ(before, strands_with({}, 7));
    const std::vector<std::pair<std::string, std::string>> changes = {
        {"wind.speed", "9"},
        {"procedural.fur.length", "0.3"},
        {"wind.jiggle.damping", "0.5"},
        {"procedural.fur.count", "300"},
        {"wind.speed", "{ keys = [[1, 2], [12, 8]] }"},
        {"wind.gusts.num_gusts", "3"},
        {"tolerance", "0.0005"}};
    for (const auto& [key, value] : changes) {
        scene.set(key, value);
        EXPECT_EQ(strands(*scene.shot(), 7), strands_with(scene.settings(), 7)) << key;
        EXPECT_EQ(scene.shot(), loaded) << key << ": the scene was loaded anew";
    }
    scene.set("mesh.ball.radius", "0.6"); // a mesh: loaded anew
    EXPECT_NE(scene.shot(), loaded);
    EXPECT_EQ(strands(*scene.shot(), 7), strands_with(scene.settings(), 7));
    scene.reset();
    EXPECT_EQ(strands(*scene.shot(), 7), before);
}

TEST_F(OpenSceneTest, KeepsTheLastGoodState) {
    OpenScene scene(file, {}, stop);
    scene.load();
    scene.set("wind.speed", "8");
    const std::vector<float> good = strands(*scene.shot(), 3);
    const uint64_t revision = scene.revision();
    for (const auto& [key, value] :
         std::vector<std::pair<std::string, std::string>>{{"wind.speed", "\"fast\""},
                                                          {"wind.speeed", "3"},
                                                          {"wind.response", "[[0, 1], [1, 1]]"},
                                                          {"procedural.fur.count", "-1"},
                                                          {"procedural.fur.on", "\"none\""},
                                                          {"", "3"},
                                                          {"a=b", "3"},
                                                          {"material.hair.color", "[9, 9, 9]"},
                                                          {"camera.target", "[0, 1, 4]"},
                                                          {"procedural.fur.cvs", "1"}}) {
        EXPECT_THROW(scene.set(key, value), InputError) << key << " = " << value;
        EXPECT_EQ(scene.revision(), revision);
        EXPECT_EQ(strands(*scene.shot(), 3), good) << key << " = " << value;
    }
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.speed", "8"}}));
}

TEST_F(OpenSceneTest, UndoesAndRedoes) {
    OpenScene scene(file, {}, stop);
    scene.load();
    EXPECT_FALSE(scene.can_undo());
    for (const char* speed : {"7", "8", "9"}) scene.set("wind.speed", speed);
    scene.undo(), scene.undo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.speed", "7"}}));
    scene.redo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.speed", "8"}}));
    scene.set("wind.calm", "0.5");
    EXPECT_FALSE(scene.can_redo());
    scene.reset();
    EXPECT_TRUE(scene.changed().empty());
    scene.undo();
    EXPECT_EQ(scene.changed().size(), 2U);
    scene.set("wind.speed", std::nullopt);
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.calm", "0.5"}}));
    for (int i = 0; i < 10; ++i) scene.undo();
    EXPECT_TRUE(scene.changed().empty());
}

TEST_F(OpenSceneTest, ADragIsOneStepOfUndo) {
    OpenScene scene(file, {}, stop);
    scene.load();
    scene.set("wind.calm", "0.5");
    for (const char* speed : {"7", "8", "9"}) scene.set("wind.speed", speed, 11);
    for (const char* speed : {"8", "7"}) scene.set("wind.speed", speed, 12);
    scene.set("wind.speed", "1");
    scene.set("wind.speed", "2");
    const auto speed_after_undo = [&] {
        scene.undo();
        return scene.shot()->description.wind.number("speed");
    };
    EXPECT_EQ(speed_after_undo(), 1.0);
    EXPECT_EQ(speed_after_undo(), 7.0);
    EXPECT_EQ(speed_after_undo(), 9.0);
    EXPECT_EQ(speed_after_undo(), 6.0);
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.calm", "0.5"}}));
    scene.set("wind.speed", "3", 11); // the same number, but not the same drag any more
    scene.undo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.calm", "0.5"}}));
}

TEST_F(OpenSceneTest, DoesNotSaveIntoAFileWithMistakes) {
    OpenScene scene(file, {}, stop);
    scene.load();
    scene.set("wind.speed", "9");
    std::string text = scene_text;
    text.replace(text.find("speed = 6"), 9, "clam = 0.");
    write(text);
    EXPECT_THROW(scene.save(), InputError);
    EXPECT_EQ(read(file), text);
    EXPECT_EQ(scene.changed().size(), 1U);
    write(scene_text);
    scene.save();
    EXPECT_NE(read(file).find("speed = 9"), std::string::npos);
}

TEST_F(OpenSceneTest, SavesChangedValuesAndNothingElse) {
    OpenScene scene(file, {}, stop);
    scene.load();
    scene.set("wind.speed", "9.5");
    scene.set("procedural.fur.length", "[0.1, 0.3]");
    const std::vector<float> shown = strands(*scene.shot(), 5);
    scene.save();
    std::string expected = scene_text;
    expected.replace(expected.find("speed = 6  "), 11, "speed = 9.5");
    std::string text = read(file);
    EXPECT_NE(text.find("speed = 9.5"), std::string::npos);
    EXPECT_NE(text.find("# m/s"), std::string::npos);
    EXPECT_NE(text.find("length = [0.1, 0.3]"), std::string::npos);
    EXPECT_TRUE(text.starts_with("# A head of hair.\nfps = 24\n"));
    EXPECT_TRUE(scene.changed().empty());
    EXPECT_FALSE(files_changed(scene)); // not by others
    EXPECT_EQ(strands(*scene.shot(), 5), shown);
    EXPECT_EQ(strands_with({}, 5), shown);
    scene.save(); // nothing to write
    EXPECT_EQ(read(file), text);
}

TEST_F(OpenSceneTest, UndoesBeyondASave) {
    OpenScene scene(file, {}, stop);
    scene.load();
    const std::vector<float> at_first = strands(*scene.shot(), 5);
    scene.set("wind.speed", "9.5");
    const std::vector<float> faster = strands(*scene.shot(), 5);
    scene.set("wind.global_rotate", "0.25"); // which the file does not have
    scene.set("wind.gusts.control", "[{ strength = 2 }, { strength = 3 }]");
    const std::vector<float> gusty = strands(*scene.shot(), 5);
    scene.undo();
    scene.save();
    EXPECT_TRUE(scene.changed().empty() && scene.can_undo() && scene.can_redo());
    const std::string saved = read(file);
    scene.undo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.global_rotate", "0.6"}}));
    EXPECT_EQ(strands(*scene.shot(), 5), faster);
    scene.undo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.global_rotate", "0.6"}, {"wind.speed", "6"}}));
    EXPECT_EQ(strands(*scene.shot(), 5), at_first);
    EXPECT_FALSE(scene.can_undo());
    EXPECT_EQ(read(file), saved); // until it is saved again
    for (int i = 0; i < 3; ++i) scene.redo();
    EXPECT_EQ(strands(*scene.shot(), 5), gusty);
    scene.save();
    EXPECT_NE(read(file).find("[\n    { strength = 2 },\n    { strength = 3 },\n]"), std::string::npos)
        << read(file);
    scene.undo();
    EXPECT_EQ(scene.changed(), (ChangedValues{{"wind.gusts.control", "[]"}}));
    EXPECT_TRUE(handles_of(*scene.shot()).empty());
    scene.reset();
    // A value that had none before, and has no default, is where it ends.
    scene.set("camera.focus", "2");
    scene.save();
    EXPECT_FALSE(scene.can_undo());
}

TEST_F(OpenSceneTest, TakesUpWhatAnEditorSaves) {
    OpenScene scene(file, {}, stop);
    scene.load();
    EXPECT_FALSE(files_changed(scene));
    scene.set("wind.calm", "0.5");
    std::string text = scene_text;
    text.replace(text.find("speed = 6"), 9, "speed = 60");
    write("half of it");
    EXPECT_FALSE(scene.files_changed());
    write(text);
    EXPECT_FALSE(scene.files_changed()); // it is being written
    EXPECT_TRUE(scene.files_changed());
    EXPECT_FALSE(files_changed(scene)); // once
    scene.load();
    EXPECT_EQ(scene.shot()->description.wind.number("speed"), 60.0);
    EXPECT_EQ(scene.shot()->description.wind.number("calm"), 0.5);
    write("speed = ");
    EXPECT_TRUE(files_changed(scene));
    EXPECT_THROW(scene.load(), InputError);
    EXPECT_EQ(scene.shot()->description.wind.number("speed"), 60.0);
    fs::remove(file); // an editor that replaces it
    EXPECT_FALSE(files_changed(scene));
    write(scene_text);
    EXPECT_TRUE(files_changed(scene));
    scene.load();
    EXPECT_EQ(scene.shot()->description.wind.number("speed"), 6.0);
}

TEST_F(OpenSceneTest, WatchesFilesThatValuesName) {
    const auto obj = [&](const char* name, float size) {
        std::ofstream(folder / name) << fmt::format("v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nf 1 2 3\n", size);
    };
    std::string text = scene_text;
    text.replace(text.find("type = \"sphere\"\nradius = 0.5"), 28, "type = \"file\"\nfile = \"a.obj\"");
    write(text);
    OpenScene scene(file, {}, stop);
    EXPECT_THROW(scene.load(), InputError); // there is no a.obj
    EXPECT_FALSE(files_changed(scene));
    obj("a.obj", 1.0F);
    EXPECT_TRUE(files_changed(scene));
    scene.load();
    obj("b.obj", 1.0F);
    EXPECT_FALSE(files_changed(scene));
    const uint64_t loads = scene.loads();
    scene.set("mesh.ball.file", "\"b.obj\"");
    EXPECT_EQ(scene.loads(), loads + 1);
    EXPECT_FALSE(files_changed(scene));
    obj("b.obj", 1.25F);
    EXPECT_TRUE(files_changed(scene));
    const auto mask = [&](char grey) {
        std::ofstream(folder / "mask.pgm", std::ios::binary) << "P5 1 1 255\n" << grey;
    };
    mask('\x7f');
    const uint64_t before = scene.loads();
    scene.set("procedural.fur.density_mask", "\"mask.pgm\"");
    EXPECT_EQ(scene.loads(), before);
    EXPECT_FALSE(files_changed(scene));
    fs::last_write_time(folder / "mask.pgm", fs::file_time_type::clock::now() - std::chrono::hours(1));
    EXPECT_TRUE(files_changed(scene));
}

// --set of something in a list that is replaced as a whole, and saved.
TEST_F(OpenSceneTest, SavesAListThatAnOptionHadChanged) {
    std::string text = scene_text;
    text.replace(text.find("jiggle ="), 0, "gusts = { control = [{ strength = 2 }] }\n");
    write(text);
    Overrides overrides;
    overrides.settings = {"wind.gusts.control[0].strength=0.5"};
    OpenScene scene(file, overrides, stop);
    scene.load();
    scene.set("wind.gusts.control", "[]");
    EXPECT_TRUE(handles_of(*scene.shot()).empty());
    scene.save();
    EXPECT_TRUE(scene.changed().empty());
    scene.set("wind.speed", "7");
    EXPECT_EQ(scene.shot()->description.wind.number("speed"), 7.0);
}

TEST_F(OpenSceneTest, TakesUpACorrectedFileOfABrokenScene) {
    const auto obj = [&](const char* faces) {
        std::ofstream(folder / "a.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\n" << faces;
    };
    std::string text = scene_text;
    text.replace(text.find("type = \"sphere\"\nradius = 0.5"), 28, "type = \"file\"\nfile = \"a.obj\"");
    write(text);
    obj("f 1 2 9\n");
    OpenScene scene(file, {}, stop);
    EXPECT_THROW(scene.load(), InputError);
    EXPECT_FALSE(files_changed(scene));
    obj("f 1 2 3\n\n");
    EXPECT_TRUE(files_changed(scene));
    scene.load();
}

TEST_F(OpenSceneTest, HandlesAreWhereTheValuesSay) {
    std::string text = scene_text;
    text.replace(
        text.find("jiggle ="), 0,
        "gusts = { control = [{ shape = \"box\", inner = [0.5, 1, 1], transform = { translate = [1, 2, 3] } "
        "}, "
        "{ transform = { keys = [{ frame = 1 }, { frame = 9, translate = [4, 0, 0] }], interpolation = "
        "\"smooth\" } }] }\nfield = [{ velocity = [1, 0, 0] }]\n");
    write(text);
    OpenScene scene(file, {}, stop);
    scene.load();
    const nlohmann::json handles = handles_of(*scene.shot());
    ASSERT_EQ(handles.size(), 3U);
    EXPECT_EQ(handles[0]["key"], "wind.gusts.control[0].transform");
    EXPECT_EQ(handles[0]["shape"], "box");
    EXPECT_EQ(handles[0]["inner"], (std::vector<double>{0.5, 1, 1}));
    EXPECT_EQ((handles[0]["keys"].get<std::vector<double>>()),
              (std::vector<double>{0, 1, 2, 3, 0, 0, 0, 1, 1, 1}));
    EXPECT_EQ(handles[1]["keys"].size(), 20U);
    EXPECT_EQ(handles[1]["interpolation"], "smooth");
    EXPECT_EQ(handles[2]["kind"], "field");
    EXPECT_EQ(handles[2]["keys"].size(), 10U);
    scene.set("wind.gusts.control[1].strength", "0.5");
    scene.set("wind.gusts.control", "[{ strength = 2 }]"); // what was changed within is gone with it
    EXPECT_EQ(scene.changed().size(), 1U);
    EXPECT_EQ(handles_of(*scene.shot()).size(), 2U);
    scene.undo();
    EXPECT_EQ(handles_of(*scene.shot()).size(), 3U);
}

TEST_F(OpenSceneTest, DrawnCurvesFollowTheirPoints) {
    std::string text = scene_text;
    text += R"(
[[curves]]
name = "guide"
type = "points"
points = [[-0.5, 0, 0], [0.5, 0, 0]]
)";
    text.replace(text.find("jiggle ="), 0,
                 "field = [{ shape = \"curves\", along = \"guide\", reach = 0.5 }]\n");
    write(text);
    OpenScene scene(file, {}, stop);
    scene.load();
    const std::vector<float> before = strands(*scene.shot(), 3);
    const uint64_t loads = scene.loads();
    EXPECT_EQ(handles_of(*scene.shot())[1]["key"], "curves.guide.points");
    scene.set("curves.guide.points", "[[0, 0, -0.5], [0, 0, 0.5]]");
    EXPECT_EQ(scene.loads(), loads);
    EXPECT_EQ(strands(*scene.shot(), 3),
              strands_with({"curves.guide.points=[[0, 0, -0.5], [0, 0, 0.5]]"}, 3));
    EXPECT_NE(strands(*scene.shot(), 3), before);
    EXPECT_THROW(scene.set("curves.guide.points", "[[0, 0, 0]]"), InputError);
    scene.undo();
    EXPECT_EQ(strands(*scene.shot(), 3), before);
    EXPECT_EQ(scene.loads(), loads);
}

TEST_F(OpenSceneTest, RandomGustsAreWhereTheStrandsFeelThem) {
    std::string text = scene_text;
    text.replace(
        text.find("jiggle ="), 0,
        "gusts = { num_gusts = 3, radius_range = [0.3, 0.6], radius_noise_range = [0, 0], period = 24 }\n");
    write(text);
    OpenScene scene(file, {}, stop);
    scene.load();
    size_t touched = 0, missed = 0;
    for (int frame = 1; frame <= 24; ++frame) {
        set_frame(*scene.shot(), frame);
        BuildSettings settings = build_settings(*scene.shot(), frame);
        settings.shutter_open = settings.shutter_close = 0.0;
        settings.trace_curves = false;
        settings.attributes = {"gust"};
        BuildProgress progress;
        BuildStats stats;
        const World world = build_world(scene.shot()->geometry, settings, stop, progress, stats);
        const auto gusts = scene.shot()->geometry.procedurals[0]->gusts();
        const CurveGeometry& curves = world.curves.at(0);
        const std::vector<float>& felt = curves.attributes.at(0).values;
        const CurveLayout layout = curves.layout();
        for (uint64_t c = 0; c < curves.curve_count; ++c) {
            const float* const root = curves.vertices[0] + 4 * (layout.first_vertex(c) + 1);
            bool inside = false;
            for (const auto& gust : gusts)
                inside = inside || (Vec3f(root[0], root[1], root[2]).cast<double>() - gust.center).norm() <
                                       gust.radius - 1e-3; // the root stands a little above the skin
            const float value = felt[layout.first_vertex(c) - 2 * c];
            touched += inside && value > 0.0F;
            missed += inside && !(value > 0.0F);
        }
    }
    EXPECT_GT(touched, 100U);
    EXPECT_EQ(missed, 0U);
}

class ShownWindTest : public OpenSceneTest {
  protected:
    // The scene with more lines of [wind], at a frame. The shot is in `scene`.
    World world_of(const std::string& wind, double frame, MarramStage stage = MARRAM_FINAL) {
        std::string text = scene_text;
        text.replace(text.find("jiggle ="), 0, wind);
        write(text);
        scene.emplace(file, Overrides{}, stop);
        scene->load();
        set_frame(*scene->shot(), frame);
        BuildSettings settings = build_settings(*scene->shot(), frame);
        settings.trace_curves = false;
        settings.stage = stage;
        settings.attributes = {"root_normal", "shield"};
        BuildProgress progress;
        BuildStats stats;
        return build_world(scene->shot()->geometry, settings, stop, progress, stats);
    }
    std::optional<OpenScene> scene;
};

TEST_F(ShownWindTest, TheAirHasFieldsGustsAndNoise) {
    world_of(
        "calm = 0.25\ngusts = { control = [{ transform = { translate = [5, 0, 0] } }] }\n"
        "field = [{ shape = \"sphere\", velocity = [0, 3, 0], transform = { translate = [-5, 0, 0] } }]\n",
        3);
    WireMessage message;
    add_air(*scene->shot(), {{0.0, 0.0, 0.0}, {15.0, 0.0, 0.0}, {0.0, 0.0, 0.5}, 3, 1}, message);
    ASSERT_EQ(message.header["air"]["counts"], (nlohmann::json{3, 1}));
    const auto* v = reinterpret_cast<const float*>(message.at(message.header["air"]["offset"].get<size_t>()));
    for (int i = 0; i < 3; ++i) {
        EXPECT_NEAR(v[7 * i], 6.0, 1e-5); // the wind blows along x
        EXPECT_GT(std::hypot(v[7 * i + 3], v[7 * i + 4], v[7 * i + 5]), 0.01);
        EXPECT_LT(std::hypot(v[7 * i + 3], v[7 * i + 4], v[7 * i + 5]), 0.4 * std::sqrt(3.0));
    }
    EXPECT_NEAR(v[1], 0.0, 1e-5); // at -10
    EXPECT_NEAR(v[6], 0.25, 1e-6);
    WireMessage near;
    add_air(*scene->shot(), {{-5.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, 1, 1}, near);
    EXPECT_NEAR(reinterpret_cast<const float*>(near.at(0))[1], 3.0, 1e-5); // in the field
    add_air(*scene->shot(), {{5.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, 1, 1}, near);
    EXPECT_GT(reinterpret_cast<const float*>(near.at(near.header["air"]["offset"].get<size_t>()))[6], 0.9F);
}

TEST_F(ShownWindTest, RaysFindTheShelterThatStrandsHave) {
    for (const char* more : {"", ", spread = 20, rays = 12", ", wake = 2"}) {
        const std::string wind = fmt::format("shielding = {{ shield = 1{} }}\n", more);
        const World blown = world_of(wind, 3);
        const CurveGeometry& curves = blown.curves.at(0);
        const CurveLayout layout = curves.layout();
        const std::vector<float> felt = find_attribute(curves.attributes, "shield")->values;
        const World rest = world_of(wind, 3, MARRAM_REST);
        size_t some = 0;
        for (uint64_t strand = 0; strand < layout.curve_count; strand += 7) {
            const nlohmann::json message = rays_message(*scene->shot(), rest, 0, strand);
            EXPECT_NEAR(message["shelter"].get<double>(),
                        double(felt[layout.first_vertex(strand) - 2 * strand]), 0.02)
                << more << " " << strand;
            EXPECT_EQ(message["rest"].size(), layout.cvs(strand));
            some += message["shelter"].get<double>() > 0.0;
        }
        EXPECT_GT(some, 3U);
    }
    const World none = world_of("", 3, MARRAM_REST);
    EXPECT_TRUE(rays_message(*scene->shot(), none, 0, 1)["rays"].empty());
}

TEST_F(OpenSceneTest, WarnsOnceOfEachThing) {
    const auto picture = [&](const char* name, const char* values) { // two equal pixels of floats
        std::ofstream out(folder / name);
        out << "PF\n2 1\n-1.0\n" << std::string(values, 12) << std::string(values, 12);
    };
    picture("good.pfm", "\0\0\x80\x3f\0\0\x80\x3f\0\0\x80\x3f");
    picture("below.pfm", "\0\0\x80\xbf\0\0\x80\x3f\0\0\x80\x3f"); // -1, 1, 1
    write(std::string(scene_text) +
          "\n[[light]]\nname = \"sky\"\ntype = \"environment\"\nfile = \"below.pfm\"\n");
    OpenScene scene(file, {}, stop);
    scene.load();
    EXPECT_EQ(light_warnings_of(*scene.shot()).size(), 1U); // it has pixels below 0
    scene.set("light.sky.strength", "0.5");
    for (const char* speed : {"1", "2", "3"}) scene.set("wind.speed", speed);
    EXPECT_EQ(light_warnings_of(*scene.shot()).size(), 1U);
    EXPECT_EQ(warnings_of(*scene.shot()).size(), 0U);
    scene.set("light.sky.file", "\"good.pfm\"");
    EXPECT_EQ(light_warnings_of(*scene.shot()).size(), 0U);
}

// Each strand's id and vertices at a frame.
std::map<float, std::vector<float>> strands_by_id(Shot& shot, double frame, double share, uint64_t& all) {
    static const std::atomic<bool> never{false};
    set_frame(shot, frame);
    BuildSettings settings = build_settings(shot, frame);
    settings.shutter_open = settings.shutter_close = 0.0;
    settings.trace_curves = false;
    settings.attributes = {"id"};
    settings.share = share;
    BuildProgress progress;
    BuildStats stats;
    const World world = build_world(shot.geometry, settings, never, progress, stats);
    const CurveGeometry& curves = world.curves.at(0);
    const CurveLayout layout = curves.layout();
    std::map<float, std::vector<float>> strands;
    for (uint64_t c = 0; c < curves.curve_count; ++c) {
        const float* const at = curves.vertices[0] + 4 * layout.first_vertex(c);
        strands[curves.attributes.at(0).values[c]] = {at, at + 4 * (layout.cvs(c) + 2)};
    }
    all = curves.all_curves;
    return strands;
}

// BuildSettings::share, by frames in sequence, so that jiggle keeps states; the settings that the tolerance
// chooses are those of all strands.
TEST_F(OpenSceneTest, AShareOfTheStrandsAreThoseOfAll) {
    OpenScene few(file, {}, stop), whole(file, {}, stop);
    few.load(), whole.load();
    std::map<float, std::vector<float>> before;
    for (const auto& [frame, share] : std::vector<std::pair<double, double>>{{4.0, 0.1},
                                                                             {5.0, 0.1},
                                                                             {5.5, 0.1},
                                                                             {6.0, 0.4},
                                                                             {7.0, 0.4},
                                                                             {8.0, 0.9},
                                                                             {3.0, 1.0},
                                                                             {9.0, 0.2}}) {
        uint64_t all = 0;
        const auto some = strands_by_id(*few.shot(), frame, share, all);
        EXPECT_EQ(all, 200U);
        const auto every = strands_by_id(*whole.shot(), frame, 0.0, all);
        EXPECT_EQ(every.size(), 200U);
        EXPECT_NEAR(double(some.size()), 200.0 * share, 20.0);
        for (const auto& [id, vertices] : some) {
            ASSERT_EQ(vertices, every.at(id)) << frame << " " << share;
        }
        for (const auto& [id, vertices] : before) {
            EXPECT_TRUE(some.contains(id) || some.size() < before.size());
        }
        before = some;
    }
}

// The text of each value, taken as a setting, gives the same value.
TEST(ValueText, IsReadAsTheSameValue) {
    int compared = 0;
    for (const auto& entry : fs::directory_iterator(MARRAM_SOURCE_DIR "/scenes")) {
        if (entry.path().extension() != ".toml") continue;
        PluginSet plugins = default_plugins();
        const SceneDescription scene = describe_scene(entry.path().string(), {}, plugins);
        std::vector<std::string> settings;
        const auto add = [&](const std::string& prefix, const ParamSet& values) {
            for (const ParamValue& value : values.all())
                if (value.given && list_of(value.spec->name).empty() &&
                    value.name.find('[') == std::string::npos)
                    settings.push_back(prefix + value.name + "=" + value_text(value, scene.file));
        };
        add("", scene.globals), add("camera.", scene.camera), add("film.", scene.film),
            add("wind.", scene.wind);
        for (const Item& item : scene.procedurals)
            add("procedural." + item.name_in_file() + ".", item.params);
        for (const Item& item : scene.materials) add("material." + item.name_in_file() + ".", item.params);
        for (const Item& item : scene.meshes) add("mesh." + item.name_in_file() + ".", item.params);
        const SceneDescription again = describe_scene(entry.path().string(), settings, plugins);
        const auto compare = [&](const ParamSet& a, const ParamSet& b) {
            ASSERT_EQ(a.all().size(), b.all().size());
            for (size_t i = 0; i < a.all().size(); ++i) {
                const ParamValue &x = a.all()[i], &y = b.all()[i];
                EXPECT_TRUE(x.numbers == y.numbers && x.text == y.text && x.texts == y.texts &&
                            x.keys == y.keys)
                    << entry.path() << " " << x.name << ": " << value_text(x, scene.file);
                ++compared;
            }
        };
        compare(scene.globals, again.globals), compare(scene.camera, again.camera),
            compare(scene.film, again.film);
        compare(scene.wind, again.wind);
        for (const auto list :
             {&SceneDescription::procedurals, &SceneDescription::materials, &SceneDescription::meshes})
            for (size_t i = 0; i < (scene.*list).size(); ++i)
                compare((scene.*list)[i].params, (again.*list)[i].params);
    }
    EXPECT_GT(compared, 5000);
}

} // namespace
} // namespace marram
