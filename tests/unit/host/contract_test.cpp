// SPDX-License-Identifier: Apache-2.0
// What a procedural is given of the scene and how its report is used, tested with a library that reports its
// input.
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

namespace marram::testing {
namespace {

// The probe defines its own wind parameters: no other library is loaded.
struct ProbeScene {
    std::shared_ptr<PluginLibrary> library =
        std::make_shared<PluginLibrary>(MARRAM_BINARY_DIR "/libprobe_plugin.so", Place{});
    Schema schema = scene_schema();
    SceneDescription description;
    std::atomic<bool> cancel{false};
    SceneGeometry geometry;
    BuildSettings settings;
    BuildProgress progress;
    BuildStats stats;

    explicit ProbeScene(const std::string& text) {
        schema.wind = wind_specs(*library);
        schema.procedurals = procedural_schemas(*library);
        description = load_scene(write_scene(text), {}, schema);
        for (const Item& item : description.meshes) {
            const ParamValue& keys = item.params.at("transform");
            geometry.meshes.push_back(
                {item.name, builtin_mesh(item), KeyedTransform(keys.numbers, keys.text)});
        }
        for (const Item& item : description.procedurals)
            geometry.procedurals.push_back(
                std::make_unique<Procedural>(library, item, description.wind, cancel));
    }
    World build() { return build_world(geometry, settings, cancel, progress, stats = {}); }

    // One probe's report without its made-up entries.
    std::map<std::string, double> report(size_t index = 0) {
        std::map<std::string, double> entries;
        for (const auto& [key, value] : geometry.procedurals[index]->report()) entries[key] = value;
        return entries;
    }
    // One probe's values by name.
    std::map<std::string, double> values(size_t index = 0) {
        std::map<std::string, double> found;
        for (const auto& [key, value] : report(index))
            if (key.starts_with("value.")) found[key.substr(6)] = value;
        return found;
    }
};

std::string probe(const std::string& name, const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"probe\"\nname = \"" + name + "\"\n" + more + "\n";
}

using Values = std::map<std::string, double>;

TEST(Lists, AreHandedOverElementByElement) {
    ProbeScene scene("[wind]\nplain = 5\n[[wind.balls]]\nsize = 7\nmaybe = 9\n[[wind.balls]]\n"
                     "keys = { keys = [{ frame = 4 }, { frame = 6 }], interpolation = \"smooth\" }\n" +
                     probe("p", "own = [{}, { number = 8 }]"));
    EXPECT_EQ(scene.values(), (Values{{"pose_at", 0},
                                      {"report", 1},
                                      {"own[0].number", 3},
                                      {"own[1].number", 8},
                                      {"wind.plain", 5},
                                      {"wind.balls[0].size", 7},
                                      {"wind.balls[0].keys", 0},
                                      {"wind.balls[0].maybe", 9},
                                      {"wind.balls[1].size", 2},
                                      {"wind.balls[1].keys", 4}}));
    const auto report = scene.report();
    EXPECT_EQ(report.at("numbers.wind.balls[0].keys"), 10);
    EXPECT_EQ(report.at("letters.wind.balls[0].keys"), 6); // includes "linear"
    EXPECT_EQ(report.at("numbers.wind.balls[1].keys"), 20);
}

TEST(Lists, OfAProceduralReplaceThoseOfTheScene) {
    const std::string wind = "[wind]\nballs = [{ size = 7, maybe = 9 }, {}]\n";
    ProbeScene scene(wind + probe("own", "wind.balls = [{ size = 1 }]") + probe("none", "wind.balls = []") +
                     probe("scene's", "wind.plain = 4"));
    const Values common = {{"pose_at", 0}, {"report", 1}, {"wind.plain", 1}};
    Values own = common;
    own["wind.balls[0].size"] = 1;
    own["wind.balls[0].keys"] = 0;
    EXPECT_EQ(scene.values(0), own);
    EXPECT_EQ(scene.values(1), common);
    Values shared = {{"pose_at", 0},
                     {"report", 1},
                     {"wind.plain", 4},
                     {"wind.balls[0].size", 7},
                     {"wind.balls[0].keys", 0},
                     {"wind.balls[0].maybe", 9},
                     {"wind.balls[1].size", 2},
                     {"wind.balls[1].keys", 0}};
    EXPECT_EQ(scene.values(2), shared);
    ProbeScene without(probe("p"));
    EXPECT_EQ(without.values(), common);
}

// A vertex and its normal at any time, for a quarter turn about z between two keys and a translation.
TEST(Poses, HaveNormalsAtAnyTime) {
    for (const double frame : {-3.0, 1.0, 2.0, 7.0}) {
        ProbeScene scene(
            mesh("b", "sphere",
                 "transform = { keys = [{ frame = 1, scale = [1, 2, 4] }, { frame = 3, rotate = [0, 0, "
                 "90], scale = [1, 2, 4], translate = [4, 0, 0] }] }") +
            probe("p", "pose_at = " + std::to_string(frame)));
        scene.build();
        const SceneMesh& source = scene.geometry.meshes[0];
        const Eigen::Affine3d at = source.transform.at(frame);
        const Vec3d position = at * source.mesh.positions[0].cast<double>();
        const Vec3d normal =
            (at.linear().inverse().transpose() * source.mesh.normals[0].cast<double>()).normalized();
        const auto report = scene.report();
        const Vec3d p(report.at("position.x"), report.at("position.y"), report.at("position.z"));
        const Vec3d n(report.at("normal.x"), report.at("normal.y"), report.at("normal.z"));
        EXPECT_LT((p - position).norm(), 1e-6) << frame;
        EXPECT_LT((n - normal).norm(), 1e-6) << frame;
    }
}

TEST(Poses, OfFacettedMeshesLeaveNormalsAlone) {
    ProbeScene scene(mesh("b", "sphere") + probe("p"));
    scene.geometry.meshes[0].mesh.normals.clear(); // the probe's buffer stays zero
    scene.build();
    const auto report = scene.report();
    EXPECT_NE(report.at("position.y"), 0.0); // a pole
    for (const char* key : {"normal.x", "normal.y", "normal.z"}) EXPECT_EQ(report.at(key), 0.0);
}

TEST(Report, SharesSecondsAndAddsCounts) {
    ProbeScene scene(probe("p", "report = 1") + probe("q", "report = 10"));
    scene.build();
    const Report& report = scene.stats.report;
    ASSERT_GT(report("seconds.collide"), 0.0);
    const double unit =
        report("seconds.collide") / 6.0; // the probe reports 1 ... 6 seconds, in the chain's order
    EXPECT_NEAR(report("seconds.jiggle"), 5.0 * unit, 1e-12);
    EXPECT_NEAR(report("seconds.bend"), 4.0 * unit, 1e-12);
    EXPECT_NEAR(report("seconds.shield"), 3.0 * unit, 1e-12);
    EXPECT_NEAR(report("seconds.gusts"), 2.0 * unit, 1e-12);
    EXPECT_GE(report("seconds.expand"), unit - 1e-12); // includes the time for bounds
    EXPECT_EQ(report("collision.contacts"), 22.0);     // not declared: a sum
    EXPECT_EQ(report("collision.dips"), 66.0);
    EXPECT_DOUBLE_EQ(report("collision.reached"), 7.0 / 8.0);
    EXPECT_EQ(report("value.report"), 10.0); // the maximum
    const auto& each = report.entries().at("value.pose_at").each;
    EXPECT_EQ(each.size(), 2u);
    EXPECT_TRUE(each.contains("p") && each.contains("q"));
}

TEST(Report, WithoutEntriesCountsNothing) {
    ProbeScene scene(probe("p", "report = 0"));
    scene.build();
    const Report& report = scene.stats.report;
    EXPECT_GT(report("seconds.expand"), 0.0);
    EXPECT_EQ(strand_seconds(report), report("seconds.expand"));
    EXPECT_EQ(report("collision.contacts"), 0.0);
    EXPECT_EQ(report("collision.reached"), 1.0);
}

} // namespace
} // namespace marram::testing
