// SPDX-License-Identifier: Apache-2.0
// `marram compare` as users run it; its page: compare_page_test.cpp.
#include "program.h"

namespace marram::testing {
namespace {

Outcome rendered(const Folder& folder, const std::string& scene, const std::string& name,
                 const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"render", scene, "-o",    folder / name,   "--quiet",
                                          "--spp",  "16",  "--aov", "variance,depth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return marram(arguments);
}

} // namespace

TEST(Compare, tells_noise_from_change) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [96, 64]\nsamples = 2\nmax_depth = 3\n",
                            .groom = "count = 4000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    EXPECT_EQ(rendered(folder, scene, "seed.exr", {"--set", "film.seed=5"}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "wind.exr", {"--set", "wind.speed=0"}).code, 0);
    const Outcome same = marram({"compare", folder / "a.exr", folder / "a.exr"});
    EXPECT_EQ(same.code, 0);
    EXPECT_CONTAINS(same.out, "alike: every number is the same");
    const Outcome seed = marram({"compare", folder / "seed.exr", folder / "a.exr"});
    EXPECT_EQ(seed.code, 0) << seed.out;
    EXPECT_CONTAINS(seed.out, "\nalike\n");
    const Outcome wind = marram({"compare", folder / "wind.exr", folder / "a.exr"});
    EXPECT_EQ(wind.code, 1) << wind.out;
    EXPECT_CONTAINS(wind.out, "noise cannot explain it: ");
    EXPECT_CONTAINS(wind.out, "\ndifferent\n");
    EXPECT_EQ(wind.err, "");
}

TEST(Compare, refuses_what_it_cannot_compare) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const auto& [name, size] : {std::pair("a.png", "24x16"), {"b.png", "16x24"}})
        EXPECT_EQ(marram({"render", scene, "-o", folder / name, "--quiet", "--size", size}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    folder.write("text.png", "no picture");
    const auto refused = [&](const std::vector<std::string>& arguments, const std::string& words) {
        const Outcome done = marram(arguments);
        EXPECT_EQ(done.code, 2) << words;
        EXPECT_EQ(done.out, "");
        EXPECT_CONTAINS(done.err, words);
        EXPECT_EQ(lines(done.err).size(), 1U);
    };
    refused({"compare", folder / "a.png", folder / "b.png"}, "a.png: is 24 x 16 pixels, ");
    refused({"compare", folder / "a.png", folder / "a.exr"}, "a.png: has channels R, G, B; ");
    refused({"compare", folder / "a.png", folder / "none.png"}, "none.png: there is no such file");
    refused({"compare", folder / "text.png", folder / "a.png"}, "text.png: is not an image that can be read");
    refused({"compare", folder / "a.png", folder / "a.png", "--report", folder / "a.exr"},
            "a.exr: the folder for the report cannot be made");
    refused({"compare", folder / "a.png"}, "reference is required");
    refused({"compare", folder / "a.png", folder / "b.png", "--report", folder / "page"},
            "a.png: is 24 x 16");
    EXPECT_FALSE(fs::exists(folder / "page")) << "nothing was compared, nothing is there to be read";
    const std::vector<float> grey(24 * 16, 0.5F);
    const Layer layer{"", {"Y"}, grey.data(), true};
    write_exr(folder / "grey.exr", 24, 16, std::span(&layer, 1), {});
    refused({"compare", folder / "grey.exr", folder / "a.png"}, "grey.exr: has channels Y (grey); ");
}

} // namespace marram::testing
