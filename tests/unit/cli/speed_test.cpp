// SPDX-License-Identifier: Apache-2.0
// Speed as a ratio within one run, so that it holds on any machine: making and bending strands takes little
// time compared with the BVH over them, which every path tracer needs.
#include "program.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>

namespace marram::testing {
namespace {

TEST(Speed, OfStrandsIsSmallBesideTheBvh) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.groom = "count = 100000\ncvs = 8\nlength = [0.1, 0.2]\nwidth = 0.002\n"});
    // The median of five runs; each ratio is taken within one run.
    std::vector<double> ratios;
    nlohmann::json stats;
    for (int run = 0; run < 5; ++run) {
        EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--size", "4x4", "--spp", "1",
                            "--threads", "2", "--stats", folder / "a.json"}));
        stats = nlohmann::json::parse(read_file(folder / "a.json"));
        const double place = stats["seconds"]["place_roots"], expand = stats["seconds"]["expand"],
                     bend = stats["seconds"]["bend"], bvh = stats["seconds"]["bvh"];
        fmt::print("placing {:.3f} s + expand {:.3f} s + bend {:.3f} s = {:.3f} of the BVH's {:.3f} s\n",
                   place, expand, bend, (place + expand + bend) / bvh, bvh);
        ratios.push_back((place + expand + bend) / bvh);
    }
    std::ranges::sort(ratios);
    const double cvs = stats["cvs"], extra = stats["memory"]["curve_extra_bytes"];
    fmt::print("{:.2f} extra bytes a CV\n", extra / cvs);
    EXPECT_EQ(cvs, 8e5);
    EXPECT_LT(ratios[2], 0.3);
    EXPECT_LT(extra, 8.0 * cvs);
}

// How often the time of few goes into that of many. Each is the least of three runs: whatever else runs on
// the machine only adds.
template <typename Run>
double min_ratio(Run&& seconds, const std::string& many, const std::string& few) {
    double much = INFINITY, little = INFINITY;
    for (int run = 0; run < 3; ++run) {
        much = std::min(much, double(seconds(many)));
        little = std::min(little, double(seconds(few)));
    }
    fmt::print("{:.4g} s against {:.4g} s: {:.1f} times\n", much, little, much / little);
    return much / little;
}

double stat(const Folder& folder, const std::string& scene, const char* name,
            const std::vector<std::string>& more = {}) {
    std::vector<std::string> command = {
        "render",    scene, "-o",      folder / "a.exr", "--size",         "4x4", "--spp", "1",
        "--threads", "1",   "--quiet", "--stats",        folder / "a.json"};
    command.insert(command.end(), more.begin(), more.end());
    EXPECT_DONE(marram(command));
    return nlohmann::json::parse(read_file(folder / "a.json"))["seconds"][name];
}

// Both tests take eight times as many items: 8 times the time if it is linear, 64 times if it is quadratic.
// The bound is far from both.

// Of eight times as many CVs per strand, 19 times as many segments are in contact, and the time is 13 to 15
// times as long. It was 64 times when each segment looked ahead to the tip.
TEST(Speed, OfContactIsLinearInCvs) {
    const Folder folder;
    SceneText text{.groom = "count = 500\nlength = [0.3, 0.5]\nwidth = 0.002\nclear_of = \"none\"\n"};
    text.wind = "speed = 6\nglobal_rotate = 1\nnoise = { amplitude = 0.5, frequency = 2 }\n"
                "collision = { solver = \"exact\" }\n";
    text.more = "[[mesh]]\nname = \"stone\"\ntype = \"sphere\"\nradius = 0.6\ndivisions = 30\n";
    const std::string scene = folder.write("a.toml", text);
    const auto collide = [&](const std::string& cvs) {
        return stat(folder, scene, "collide", {"--set", "procedural.grass.cvs=" + cvs});
    };
    EXPECT_LT(min_ratio(collide, "640", "80"), 32.0);
}

TEST(Speed, OfLoadingIsLinearInGusts) {
    const Folder folder;
    const auto scene_with = [&](int gusts) {
        SceneText text;
        text.more = "";
        for (int i = 0; i < gusts; ++i)
            text.more += fmt::format("[[wind.gusts.control]]\nshape = \"sphere\"\n"
                                     "transform = {{ translate = [{}, 0, 0] }}\n",
                                     1e-5 * i);
        return folder.write(fmt::format("{}.toml", gusts), text);
    };
    const std::string few = scene_with(1000), many = scene_with(8000);
    const auto load = [&](const std::string& scene) { return stat(folder, scene, "load"); };
    EXPECT_LT(min_ratio(load, many, few), 32.0);
}

} // namespace
} // namespace marram::testing
