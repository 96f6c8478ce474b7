// SPDX-License-Identifier: Apache-2.0
// Speed as a ratio within one run, so that it holds on any machine: making and bending strands is small
// beside the BVH over them that every path tracer needs.
#include "program.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace marram::testing {
namespace {

TEST(Speed, OfStrandsIsSmallBesideTheBvh) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.groom = "count = 200000\ncvs = 8\nlength = [0.1, 0.2]\nwidth = 0.002\n"});
    // The median of five runs of both, each ratio within one run.
    std::vector<double> ratios;
    nlohmann::json stats;
    for (int run = 0; run < 5; ++run) {
        EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--size", "4x4", "--spp", "1",
                            "--threads", "2", "--stats", folder / "a.json"}));
        stats = nlohmann::json::parse(read_file(folder / "a.json"));
        const double expand = stats["seconds"]["expand"], bend = stats["seconds"]["bend"],
                     bvh = stats["seconds"]["curves_bvh"];
        fmt::print("expand {:.3f} s + bend {:.3f} s = {:.3f} of the BVH's {:.3f} s\n", expand, bend,
                   (expand + bend) / bvh, bvh);
        ratios.push_back((expand + bend) / bvh);
    }
    std::ranges::sort(ratios);
    const double cvs = stats["cvs"], extra = stats["memory"]["curve_extra_bytes"];
    fmt::print("{:.2f} extra bytes a CV\n", extra / cvs);
    EXPECT_EQ(cvs, 1.6e6);
    EXPECT_LT(ratios[2], 0.2);
    EXPECT_LT(extra, 8.0 * cvs);
}

} // namespace
} // namespace marram::testing
