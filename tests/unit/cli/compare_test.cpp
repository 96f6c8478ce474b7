// SPDX-License-Identifier: Apache-2.0
// `marram compare` as users run it. Its page: compare_page_test.cpp.
#include "core/math/hash.h"
#include "program.h"

#include <cstdlib>
#include <filesystem>

#include <sys/resource.h>

namespace marram::testing {
namespace {

ProgramResult rendered(const Folder& folder, const std::string& scene, const std::string& name,
                       const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"render", scene, "-o",    folder / name,   "--quiet",
                                          "--spp",  "16",  "--aov", "variance,depth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return marram(arguments);
}

} // namespace

TEST(Compare, TellsNoiseFromChange) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = "size = [96, 64]\nsamples = 2\nmax_depth = 3\n",
                            .groom = "count = 4000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"});
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    EXPECT_EQ(rendered(folder, scene, "seed.exr", {"--set", "film.seed=5"}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "wind.exr", {"--set", "wind.speed=0"}).code, 0);
    const ProgramResult same = marram({"compare", folder / "a.exr", folder / "a.exr"});
    EXPECT_EQ(same.code, 0);
    EXPECT_CONTAINS(same.out, "alike: every number is the same");
    const ProgramResult seed = marram({"compare", folder / "seed.exr", folder / "a.exr"});
    EXPECT_EQ(seed.code, 0) << seed.out;
    EXPECT_CONTAINS(seed.out, "\nalike\n");
    const ProgramResult wind = marram({"compare", folder / "wind.exr", folder / "a.exr"});
    EXPECT_EQ(wind.code, 1) << wind.out;
    EXPECT_CONTAINS(wind.out, "more than noise: ");
    EXPECT_CONTAINS(wind.out, "\ndifferent\n");
    EXPECT_EQ(wind.err, "");
}

// Two pictures of noise alone: the exit code is that of pictures that cannot be compared.
TEST(Compare, NoiseThatHidesEverythingIsNotAlike) {
    const Folder folder;
    const std::vector<float> variance(size_t(3 * 48 * 32), 0.04F);
    for (const char* name : {"a.exr", "b.exr"}) {
        std::vector<float> rgb;
        for (uint64_t i = 0; i < variance.size(); ++i)
            rgb.push_back(hash(uint64_t(name[0]), i) % 2 == 0 ? 0.1F : 0.5F);
        const Layer layers[] = {{"", {"R", "G", "B"}, rgb.data(), false},
                                {"variance", {"R", "G", "B"}, variance.data(), false}};
        write_exr(folder / name, 48, 32, layers, std::vector<Metadata>{{"marram:samples", 16}});
    }
    const ProgramResult done = marram({"compare", folder / "a.exr", folder / "b.exr"});
    EXPECT_EQ(done.code, 2) << done.out;
    EXPECT_EQ(done.err, "");
    EXPECT_CONTAINS(done.out, "cannot tell: noise could hide a difference that people would see (");
    EXPECT_CONTAINS(done.out, " samples a pixel\n");
    EXPECT_CONTAINS(done.out, "\nfound from ");
}

TEST(Compare, RefusesWhatItCannotCompare) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const auto& [name, size] : {std::pair("a.png", "24x16"), {"b.png", "16x24"}})
        EXPECT_EQ(marram({"render", scene, "-o", folder / name, "--quiet", "--size", size}).code, 0);
    EXPECT_EQ(rendered(folder, scene, "a.exr").code, 0);
    folder.write("text.png", "no picture");
    const auto refused = [&](const std::vector<std::string>& arguments, const std::string& words) {
        const ProgramResult done = marram(arguments);
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

// Reports how files were decoded unless both are plain linear light.
TEST(Compare, SaysHowFilesWereRead) {
    const Folder folder;
    std::vector<float> rgb;
    for (int i = 0; i < 24 * 16; ++i) rgb.insert(rgb.end(), 3, 0.1F + 0.002F * float(i));
    const Layer layer{"", {"R", "G", "B"}, rgb.data(), true};
    write_exr(folder / "a.exr", 24, 16, std::span(&layer, 1), {});
    write_png(folder / "a.png", 24, 16, 3, rgb.data(), 0.0);
    const ProgramResult mixed = marram({"compare", folder / "a.png", folder / "a.exr"});
    EXPECT_EQ(mixed.code, 0) << mixed.out;
    EXPECT_CONTAINS(mixed.out, "read as      A sRGB, B linear\n");
    EXPECT_CONTAINS(mixed.out, ", of linear light\n");
    EXPECT_CONTAINS(mixed.out, ", worst window ");
    const ProgramResult linear = marram({"compare", folder / "a.exr", folder / "a.exr"});
    EXPECT_EQ(linear.out.find("read as"), std::string::npos) << linear.out;
}

TEST(Compare, AGoldenFrameIsTheReferenceWhereverItStands) {
    const Folder folder;
    const std::string golden = MARRAM_SOURCE_DIR "/scenes/golden/room.exr";
    const Image image = read_image(golden);
    std::vector<float> rgb;
    for (size_t i = 0; i < image.pixels.size(); ++i)
        if (const std::string& name = image.channel_names[i % size_t(image.channels)];
            name == "R" || name == "G" || name == "B")
            rgb.push_back(2.0F * image.pixels[i]);
    const Layer layer{"", {"R", "G", "B"}, rgb.data(), false};
    write_exr(folder / "a.exr", image.width, image.height, std::span(&layer, 1), {});
    const ProgramResult there = marram({"compare", folder / "a.exr", golden}),
                        back = marram({"compare", golden, folder / "a.exr"});
    EXPECT_EQ(there.code, 1) << there.out << there.err;
    EXPECT_EQ(back.code, 1) << back.out << back.err;
    EXPECT_CONTAINS(back.out, "golden       A carries limits: B is judged by it\n");
    EXPECT_EQ(there.out.find("golden"), std::string::npos) << there.out;
    EXPECT_CONTAINS(back.out, there.out) << "but for that line all is the same";
}

// The page replaces no picture, under any name; its folder must exist.
TEST(Compare, TheReportOverwritesNoPicture) {
    const Folder folder;
    const std::vector<float> rgb(24 * 16 * 3, 0.5F);
    const auto page = [&](const std::string& name) { return folder / (name + "/compare.html"); };
    for (const char* name : {"plain", "soft", "hard"}) fs::create_directories(folder / name);
    write_png(folder / "a.png", 24, 16, 3, rgb.data(), 0.0);
    fs::copy_file(folder / "a.png", page("plain"));
    fs::create_symlink(folder / "a.png", page("soft"));
    fs::create_hard_link(folder / "a.png", page("hard"));
    const std::map<std::string, std::string> before = folder.contents();
    const auto refused = [&](const std::string& a, const std::string& b, const std::string& report,
                             const std::string& words) {
        const ProgramResult done = marram({"compare", a, b, "--report", report});
        EXPECT_EQ(done.code, 2) << words;
        EXPECT_EQ(done.out, "");
        EXPECT_CONTAINS(done.err, words);
    };
    refused(page("plain"), folder / "a.png", folder / "plain", "the report would overwrite");
    refused(folder / "a.png", page("plain"), folder / "plain", "the report would overwrite");
    refused(folder / "a.png", folder / "a.png", folder / "soft", "the report would overwrite");
    refused(folder / "a.png", folder / "a.png", folder / "hard", "the report would overwrite");
    refused(folder / "a.png", folder / "a.png", "", "the folder for the report has no name");
    EXPECT_EQ(folder.contents(), before);
}

// With little memory the message names what did not fit, and does not speak of a scene.
TEST(Compare, WhatDoesNotFitIsNamed) {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "its own memory is beyond any limit";
#endif
    const Folder folder;
    constexpr int side = 3000; // 200 bytes a pixel: 1.8 GB
    const std::vector<float> black(size_t(side) * side * 3, 0.0F);
    write_png(folder / "a.png", side, side, 3, black.data(), 0.0);
    const ProgramResult done = marram({"compare", folder / "a.png", folder / "a.png"}, [](auto arguments) {
        const rlimit gigabyte{1U << 30, 1U << 30};
        ::setrlimit(RLIMIT_AS, &gigabyte);
        run_program(arguments);
    });
    EXPECT_EQ(done.code, 2) << done.out;
    EXPECT_CONTAINS(done.err, "a.png: comparing it with ");
    EXPECT_CONTAINS(done.err, " does not fit into memory: compare them in parts, or scaled down\n");
}

} // namespace marram::testing
