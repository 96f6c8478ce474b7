// SPDX-License-Identifier: Apache-2.0
// The bend of `marram measure`: the dials of the talk that come closest to blades, and what is said of them.
#include "core/measure/bend_trial.h"
#include "core/measure/session.h"
#include "program.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace marram::testing {
namespace {

// Stiff grass of one length, upright and of some lean: what one response and one ramp can follow.
const SceneText blades_of_grass = {
    .wind = "direction = [1, 0, 0.5]\nspeed = 9\nnoise = { amplitude = 0.5, frequency = 2 }\n"
            "gusts = { num_gusts = 20 }\ncalm = 0.3\n",
    .groom =
        "count = 200\ncvs = 9\nlength = 0.5\nwidth = 0.005\nwidth_profile = [[0, 1]]\nwidth_variation = 0\n"
        "shape = \"ribbon\"\nlean = 5\narc = 10\nbend = \"blade\"\n"
        "blade = { stiffness = 1e-3, mass = 0.0008 }\n"};

struct BendOfScene {
    Measurement measurement;

    explicit BendOfScene(const std::string& scene, const std::vector<std::string>& changes = {},
                         double bend_speed = 0.0, double seconds = 1000.0) {
        static const std::atomic<bool> never{false};
        Overrides overrides;
        overrides.settings = changes;
        const Shot shot = load_shot(scene, overrides, never);
        MeasureProgress progress(seconds);
        const MeasureRequest request{scene, overrides, 1.0, seconds, 1, 1, bend_speed};
        measure_bend(shot, Session{request, 1.0, progress, never}, seconds, measurement);
    }
    const BendResult& only() const { return measurement.bends.at(0); }
};

void print_bend(const char* name, const BendResult& bend) {
    std::printf("%s: own %.1f, 95 %% %.1f; fitted %.2f, 95 %% %.2f degrees\n", name, bend.before.median,
                bend.before.most, bend.after.median, bend.after.most);
}

TEST(MeasureBend, BringsTheTalkCloseToBlades) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", blades_of_grass);
    const BendOfScene measured(scene);
    const BendResult& bend = measured.only();
    print_bend("grass", bend);
    EXPECT_EQ(bend.groom, "grass");
    EXPECT_EQ(bend.strands, 200U);
    EXPECT_EQ(bend.max_speed, 9.0);
    ASSERT_EQ(bend.by_speed.size(), 17U);
    EXPECT_EQ(bend.by_speed[0].turned.most, 0.0);
    EXPECT_EQ(bend.by_speed[0].after.most, 0.0);
    EXPECT_GT(bend.by_speed.back().turned.median, 20.0);
    EXPECT_GT(bend.before.median, 2.0 * bend.after.median);
    EXPECT_LT(bend.after.median, 2.0);
    EXPECT_LT(bend.after.most, 6.0);
    ASSERT_EQ(bend.by_arc.size(), 4U);
    for (const BendRow& row : bend.by_arc) EXPECT_LE(row.after.median, row.after.most);
    EXPECT_EQ(bend.by_arc.back().to, 1.0);
    // Every report has it.
    const std::string table = to_table(measured.measurement), page = to_html(measured.measurement);
    for (const std::string& line : bend.dials) {
        EXPECT_CONTAINS(table, "    " + line + "\n");
        EXPECT_CONTAINS(page, line);
    }
    EXPECT_CONTAINS(to_csv(measured.measurement), "bend,\"grass: fitted dials, 9 m/s\",,0,0,");
}

// The lines have the figures of the fit, digit for digit, where a scene takes them.
TEST(MeasureBend, PrintsLinesThatHoldWhatTheySay) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", blades_of_grass);
    const BendOfScene measured(scene);
    std::vector<std::string> changes;
    for (const std::string& line : measured.only().dials) {
        std::string setting = "wind." + line;
        setting.replace(setting.find(" = "), 3, "=");
        changes.push_back(setting);
    }
    const BendOfScene pasted(scene, changes);
    EXPECT_EQ(pasted.only().before.median, measured.only().after.median);
    EXPECT_EQ(pasted.only().before.most, measured.only().after.most);
    EXPECT_EQ(pasted.only().dials, measured.only().dials);
}

// Directions that the talk's bend makes itself are met, and the dials that made them found.
TEST(MeasureBend, FindsTheDialsOfStrandsThatTheyTurned) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", blades_of_grass);
    static const std::atomic<bool> never{false};
    const MeasureRequest request{scene, {}, 1.0, 1000.0, 1, 1, 0.0};
    BendTrial trial(request, 1.0, {"procedural.grass.bend=\"talk\"", "procedural.grass.blade={}"}, "grass",
                    never);
    const auto turned = [&](double speed, const std::string& dials) {
        return trial.bent(
            {fmt::format("wind={{ direction = [1, 0, 0.5], noise = {{ amplitude = 0 }}, speed = {}, {} }}",
                         speed, dials)});
    };
    const std::vector<double> knots = {0.0, 0.12, 0.3, 0.6, 1.0}, ramp = {0.9, 0.7, 0.5, 0.4, 0.1},
                              responses = {0.05, 0.2, 0.45, 0.7, 0.8};
    const auto ramp_of = [&](const std::vector<double>& values) {
        std::string text = "ramp_rotate = [";
        for (size_t i = 0; i < values.size(); ++i)
            text += fmt::format("{}[{}, {}]", i > 0 ? ", " : "", knots[i], values[i]);
        return text + "]";
    };
    BendTargets targets;
    targets.knots = knots.size();
    for (const double response : responses)
        targets.directions.push_back(
            turned(1.0, fmt::format("response = [[0, 0], [1, {}]], global_rotate = 0.8, {}", response,
                                    ramp_of(ramp))));
    targets.weights = trial.weights();
    int calls = 0;
    const BendFit fit = fit_bend(
        targets,
        [&](const std::vector<double>& at_knots) {
            ++calls;
            return turned(1.0, "response = [[0, 0], [1, 1]], global_rotate = 1, " + ramp_of(at_knots));
        },
        [] { return false; });
    std::printf("%d steps, %d evaluations, residual %.2g\n", fit.steps, calls, fit.residual);
    EXPECT_LT(fit.residual, 0.005);
    for (size_t j = 0; j < responses.size(); ++j)
        for (size_t i = 0; i < knots.size(); ++i)
            EXPECT_NEAR(fit.strengths[j] * fit.profile[i], 0.8 * responses[j] * ramp[i], 0.01)
                << j << " " << i;
}

TEST(MeasureBend, KeepsTheKnotsThatACurveNeeds) {
    const std::vector<Vec2d> line = {{0, 0}, {1, 1}, {2, 2}, {3, 2.5}, {4, 3}};
    const std::vector<Vec2d> kept = fewer_knots(line, 1e-9);
    ASSERT_EQ(kept.size(), 3U);
    EXPECT_EQ(kept[1].x(), 2.0);
    EXPECT_EQ(fewer_knots(line, 1.0).size(), 2U);
}

// Lean and curled strands of several lengths, in wind from any side, on a ball: what the talk cannot follow is said,
// and is less than with the dials before.
TEST(MeasureBend, IsHonestAboutStrandsOfAllKinds) {
    const Folder folder;
    SceneText wild = blades_of_grass;
    wild.groom =
        "count = 200\ncvs = 0\nlength = [0.2, 0.6]\nwidth = 0.005\nlean = 40\nlean_variation = 30\narc = 60\n"
        "canopy = true\nenvelope = [[0, 0.2], [1, 1]]\nbend = \"blade\"\n"
        "blade = { modulus = 5e8, density = 700, sags = true }\n";
    wild.wind += "shielding = { shield = 1, offset = 3 }\njiggle = { damping = 0.3 }\nfield = [{ swirl = 4, "
                 "transform = "
                 "{ scale = 2 } }]\nover = \"ground\"\ncollision = { solver = \"exact\" }\n";
    const BendOfScene measured(folder.write("a.toml", wild));
    const BendResult& bend = measured.only();
    print_bend("all kinds", bend);
    EXPECT_GT(bend.by_speed[0].turned.most, 0.0) << "weight bends them in still air";
    EXPECT_LT(bend.after.median, bend.before.median);
    EXPECT_LE(bend.after.most, 90.0);
}

TEST(MeasureBend, SaysWhyThereIsNone) {
    const Folder folder;
    const auto left_out = [](const BendOfScene& bend) {
        return bend.measurement.left_out.empty() ? std::string() : bend.measurement.left_out[0];
    };
    EXPECT_EQ(left_out(BendOfScene(folder.write("talk.toml", SceneText{}))),
              "bend: no groom has bend = \"blade\"");
    SceneText still = blades_of_grass;
    still.wind = "speed = 0\n";
    const std::string calm = folder.write("calm.toml", still);
    EXPECT_CONTAINS(left_out(BendOfScene(calm)), "give the largest with --bend-speed");
    EXPECT_EQ(BendOfScene(calm, {}, 4.0).only().max_speed, 4.0);
    EXPECT_CONTAINS(left_out(BendOfScene(calm, {}, 4.0, 0.0)), "no time was left");
    // Of keys the largest counts.
    EXPECT_EQ(BendOfScene(calm, {"wind.speed={ keys = [[1, 2], [9, 7], [20, 3]] }"}).only().max_speed, 7.0);
}

} // namespace
} // namespace marram::testing
