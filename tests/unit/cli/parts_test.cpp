// SPDX-License-Identifier: Apache-2.0
// Parts of a frame, rendered alone and merged: `marram render --samples, --crop, --after, --keep-state` and
// `marram merge`.
#include "tests/unit/cli/program.h"

#include "core/image/picture.h"
#include "core/math/problem.h"
#include "core/shot/farm/merge.h"
#include "core/shot/film_part.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <atomic>
#include <map>
#include <random>

namespace marram::testing {
namespace {

class Parts : public ::testing::Test {
  protected:
    ProgramResult render(const std::string& picture, std::vector<std::string> more) const {
        std::vector<std::string> all = {"render", scene, "-o", folder / picture, "--quiet"};
        all.insert(all.end(), more.begin(), more.end());
        return marram(all, started);
    }
    ProgramResult merge(const std::vector<std::string>& states, const std::string& picture,
                        std::vector<std::string> more = {}) const {
        std::vector<std::string> all = {"merge", "-o", folder / picture};
        for (const std::string& state : states) all.push_back(folder / state);
        all.insert(all.end(), more.begin(), more.end());
        return marram(all, started);
    }
    void expect_refused(const ProgramResult& result, const std::string& what) const {
        EXPECT_EQ(result.code, 2);
        EXPECT_CONTAINS(result.err, what);
        EXPECT_EQ(std::ranges::count(result.err, '\n'), 1) << result.err;
    }
    // All layers, and what the file says of itself but for the time.
    void expect_same(const std::string& a, const std::string& b) const {
        EXPECT_TRUE(same_picture(folder / a, folder / b));
        for (const char* key : {"marram:samples", "marram:mean_samples", "marram:digest", "marram:frame"})
            EXPECT_EQ(read_metadata(folder / a, key), read_metadata(folder / b, key)) << key;
    }

    Folder folder;
    std::string scene = folder.write("a.toml", SceneText());
    marram::testing::Run started = run_program;
};

const std::vector<std::string> layered = {"--size", "32x24", "--spp",
                                          "24",     "--aov", "variance,depth,id,normal"};
std::vector<std::string> with(std::vector<std::string> options, const std::vector<std::string>& more) {
    options.insert(options.end(), more.begin(), more.end());
    return options;
}

TEST_F(Parts, AreTheWholePictureBitForBit) {
    EXPECT_DONE(render("whole.exr", layered));
    EXPECT_DONE(render("a.exr", with(layered, {"--samples", "0-4"})));
    EXPECT_DONE(
        render("a.exr", with(layered, {"--samples", "5-23", "--crop", "0,0,19,24", "--threads", "1"})));
    const ProgramResult last = render("a.exr", with(layered, {"--samples", "5-23", "--crop", "19,0,32,24"}));
    EXPECT_EQ(last.code, 0) << last.err;
    EXPECT_EQ(last.out, folder / "a.exr.crop_19_0_32_24.samples_5_23.state.tif" + "\n");
    EXPECT_FALSE(fs::exists(folder / "a.exr"));
    const std::vector<std::string> states = {"a.exr.crop_19_0_32_24.samples_5_23.state.tif",
                                             "a.exr.samples_0_4.state.tif",
                                             "a.exr.crop_0_0_19_24.samples_5_23.state.tif"};
    EXPECT_DONE(merge(states, "a.exr"));
    expect_same("a.exr", "whole.exr");
    // The picture counts as rendered, and states that are there are not rendered again.
    std::vector<std::string> again = with(layered, {"--resume"});
    std::erase(again, "--quiet");
    EXPECT_CONTAINS(marram(with({"render", scene, "-o", folder / "a.exr"}, again)).err, "is there already");
    EXPECT_CONTAINS(marram(with({"render", scene, "-o", folder / "a.exr", "--samples", "0-4"}, again)).err,
                    "a.exr.samples_0_4.state.tif: is there already");
    // The picture has all parts, also those without a state.
    EXPECT_CONTAINS(marram(with({"render", scene, "-o", folder / "a.exr", "--samples", "0-3"}, again)).err,
                    "is there already");
    EXPECT_FALSE(fs::exists(folder / "a.exr.samples_0_3.state.tif"));
    // Step by step, and to a PNG with a layer beside it.
    EXPECT_DONE(merge({states[0], states[1]}, "two.tif"));
    EXPECT_DONE(merge({"two.tif", states[2]}, "b.exr"));
    expect_same("b.exr", "whole.exr");
    EXPECT_DONE(render("whole.png",
                       with({"--size", "32x24", "--spp", "24"}, {"--png", "normal=" + folder / "n.png"})));
    EXPECT_DONE(merge({"two.tif", states[2]}, "b.png", {"--png", "normal=" + folder / "m.png"}));
    EXPECT_TRUE(same_picture(folder / "whole.png", folder / "b.png"));
    EXPECT_TRUE(same_picture(folder / "n.png", folder / "m.png"));
}

TEST_F(Parts, OfAnAdaptivePictureAreRounds) {
    const std::vector<std::string> noisy = {"--size", "32x24", "--spp", "40", "--set", "film.noise=0.02"};
    EXPECT_DONE(render("whole.exr", noisy));
    EXPECT_LT(std::stod(read_metadata(folder / "whole.exr", "marram:mean_samples").value_or("inf")), 38.0);
    EXPECT_DONE(render("a.exr", with(noisy, {"--samples", "0-15", "--crop", "0,0,32,11"})));
    EXPECT_DONE(render("a.exr", with(noisy, {"--samples", "0-15", "--crop", "0,11,32,24"})));
    EXPECT_DONE(
        merge({"a.exr.crop_0_0_32_11.samples_0_15.state.tif", "a.exr.crop_0_11_32_24.samples_0_15.state.tif"},
              "first.tif"));
    const std::string after = folder / "first.tif", more = folder / "more.tif";
    EXPECT_DONE(
        render("a.exr", with(noisy, {"--samples", "16-31", "--after", after, "--crop", "0,0,10,24"})));
    EXPECT_DONE(
        render("a.exr", with(noisy, {"--samples", "16-31", "--after", after, "--crop", "10,0,32,24"})));
    EXPECT_DONE(merge({"first.tif", "a.exr.crop_0_0_10_24.samples_16_31.state.tif",
                       "a.exr.crop_10_0_32_24.samples_16_31.state.tif"},
                      "more.tif"));
    EXPECT_DONE(render("a.exr", with(noisy, {"--samples", "32-39", "--after", more})));
    EXPECT_DONE(merge({"more.tif", "a.exr.samples_32_39.state.tif"}, "a.exr"));
    expect_same("a.exr", "whole.exr");

    expect_refused(render("a.exr", with(noisy, {"--samples", "16-31"})), "give --after the state");
    expect_refused(render("a.exr", with(noisy, {"--samples", "16-39", "--after", after})),
                   "render one round at a time, such as --samples 16-31");
    expect_refused(render("a.exr", with(noisy, {"--crop", "0,0,10,10"})), "film.noise decides after each 16");
    expect_refused(render("a.exr", with(noisy, {"--samples", "32-39", "--after", after})),
                   "has not just samples 0-31 of pixels 0,0 to 32,24");
    expect_refused(render("a.exr", {"--samples", "1-1", "--after", after}), "belongs to another scene");
    expect_refused(render("a.exr", {"--after", after}), "nothing comes before sample 0");
}

// Without film.noise, --after spares the samples that say how noisy a part is; the bits are the same.
TEST_F(Parts, GoOnAfterAStateThatKnowsTheNoise) {
    const std::vector<std::string> small = {"--size", "32x24", "--spp", "14"};
    EXPECT_DONE(render("whole.exr", small));
    for (const int first : {2, 4, 5, 9}) {
        const std::string picture = fmt::format("p{}.exr", first);
        const std::string earlier = fmt::format("{}.samples_0_{}.state.tif", picture, first - 1),
                          later = fmt::format("{}.samples_{}_13.state.tif", picture, first);
        EXPECT_DONE(render(picture, with(small, {"--samples", fmt::format("0-{}", first - 1)})));
        EXPECT_DONE(render(
            picture, with(small, {"--samples", fmt::format("{}-13", first), "--after", folder / earlier})));
        EXPECT_DONE(merge({earlier, later}, picture));
        expect_same(picture, "whole.exr");
    }
    // What is read is not written.
    const std::string after = folder / "p4.exr.samples_0_3.state.tif";
    expect_refused(render("x.exr", with(small, {"--samples", "4-13", "--after", after, "--stats", after})),
                   "would overwrite");
}

// A state that is kept goes on to more samples, and is a part like others.
TEST_F(Parts, AFinishedPictureKeepsItsStateOnRequest) {
    const std::vector<std::string> small = {"--size", "32x24"};
    EXPECT_DONE(render("a.exr", with(small, {"--spp", "6", "--keep-state"})));
    EXPECT_DONE(render("six.exr", with(small, {"--spp", "6"})));
    expect_same("a.exr", "six.exr");
    const std::string state = read_file(folder / "a.exr.state.tif");
    EXPECT_DONE(render("a.exr", with(small, {"--spp", "11", "--resume", "--keep-state"})));
    EXPECT_DONE(render("eleven.exr", with(small, {"--spp", "11"})));
    expect_same("a.exr", "eleven.exr");
    EXPECT_TRUE(fs::exists(folder / "a.exr.state.tif"));
    folder.write("six.tif", state);
    EXPECT_DONE(render("b.exr", with(small, {"--spp", "11", "--samples", "6-10"})));
    EXPECT_DONE(merge({"six.tif", "b.exr.samples_6_10.state.tif"}, "b.exr"));
    expect_same("b.exr", "eleven.exr");
    // A render with fewer samples leaves it as it is.
    EXPECT_EQ(render("a.exr", with(small, {"--spp", "3", "--keep-state"})).code, 0);
    EXPECT_EQ(render("a.exr", with(small, {"--spp", "4"})).code, 0);
    const ProgramResult short_one = render("a.exr", with(small, {"--spp", "10", "--seconds", "0.001"}));
    EXPECT_EQ(short_one.code, 0);
    EXPECT_CONTAINS(short_one.err, "has more samples than this render, and is kept");
    EXPECT_DONE(render("a.exr", with(small, {"--spp", "12", "--resume"})));
    EXPECT_DONE(render("twelve.exr", with(small, {"--spp", "12"})));
    expect_same("a.exr", "twelve.exr");
    EXPECT_FALSE(fs::exists(folder / "a.exr.state.tif")) << "nobody asked to keep it";
}

TEST_F(Parts, GoOnWhereTheyWereInterrupted) {
    const std::vector<std::string> options = {"--size", "96x64", "--spp", "180", "--samples", "2-170"};
    const std::string name = "a.exr.samples_2_170.state.tif";
    const std::vector<std::string> command = with({"render", scene, "-o", folder / "a.exr"}, options);
    EXPECT_EQ(interrupt_in("rendering", command), 130);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", name}));
    expect_refused(merge({name}, "b.exr"), "is unfinished");
    const ProgramResult resumed = marram(with(command, {"--resume"}));
    EXPECT_EQ(resumed.code, 0);
    EXPECT_CONTAINS(resumed.err, "resumed at");
    EXPECT_DONE(render("b.exr", options));
    const auto ended = [&](const std::string& part, const std::string& picture) {
        for (const char* samples : {"0-1", "171-179"})
            EXPECT_DONE(render(picture, {"--size", "96x64", "--spp", "180", "--samples", samples}));
        EXPECT_DONE(merge({part, picture + ".samples_0_1.state.tif", picture + ".samples_171_179.state.tif"},
                          picture));
    };
    ended(name, "a.exr");
    ended("b.exr.samples_2_170.state.tif", "b.exr");
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr"));
}

TEST_F(Parts, ThatDoNotFitAreRefused) {
    started = run_copy; // this process reads no pictures
    const std::vector<std::string> small = {"--size", "16x12", "--spp", "8"};
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "0-3"})));
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "3-7"})));
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "4-7", "--set", "wind.speed=1"})));
    EXPECT_DONE(render("b.exr", with(small, {"--samples", "6-7"})));
    const std::string first = "a.exr.samples_0_3.state.tif";
    const auto before = folder.contents();
    expect_refused(merge({first, "a.exr.samples_3_7.state.tif"}, "x.exr"),
                   "some of samples 3-7 of pixels 0,0 to 16,12 are also in");
    expect_refused(merge({first, first}, "x.exr"), "are also in");
    expect_refused(merge({first, "a.exr.samples_4_7.state.tif"}, "x.exr"), "belongs to another frame, scene");
    expect_refused(merge({first, "b.exr.samples_6_7.state.tif"}, "x.exr"),
                   "of this picture are missing: samples 4-5 of pixels 0,0 to 16,12");
    expect_refused(merge({"none.tif"}, "x.exr"), "there is no such file");
    expect_refused(merge({"a.toml"}, "x.exr"), "is not the state of a frame");
    expect_refused(merge({first}, "a.jpg"), "");
    expect_refused(merge({first}, first), "would overwrite");
    expect_refused(merge({first}, "x.tif", {"--png", "normal=" + folder / "d.png"}), "a state is merged");
    expect_refused(merge({first}, "x.exr", {"--partial", "--png", "depth:0-1=" + folder / "d.png"}),
                   "have no such layer");
    for (const auto& [samples, what] :
         std::map<std::string, std::string>{{"5", "is not understood from here"},
                                            {"5-", "is not understood"},
                                            {"5-4", "has no samples"},
                                            {"0-8", "the picture has 8 samples a pixel: stay within 0-7"},
                                            {"-1-4", "is not understood"},
                                            {"0-99999999999", "is not understood"},
                                            {"0-4294967295", "has no samples"}})
        expect_refused(render("x.exr", with(small, {"--samples=" + samples})), what);
    expect_refused(render("x.exr", with({"--samples", ""}, small)), "--samples"); // an empty variable
    for (const auto& [crop, what] : std::map<std::string, std::string>{
             {"0,0,16", "is not understood"},
             {"0,0,16,13", "goes beyond the picture, which has 16 x 12 pixels"},
             {"3,3,3,4", "has no pixels"},
             {"", "is not understood"},
             {"0,0,4,4,", "is not understood"}})
        expect_refused(render("x.exr", with(small, {"--crop", crop})), what);
    EXPECT_TRUE(folder.contents() == before) << "nothing is written";
    const ProgramResult partial = merge({first, "b.exr.samples_6_7.state.tif"}, "x.exr", {"--partial"});
    EXPECT_EQ(partial.code, 0);
    EXPECT_EQ(partial.out, folder / "x.partial.exr" + "\n");
    EXPECT_CONTAINS(partial.err, "missing: samples 4-5 of pixels 0,0 to 16,12");
    EXPECT_DONE(render("c.exr", with(small, {"--samples", "4-5"})));
    EXPECT_DONE(
        merge({first, "b.exr.samples_6_7.state.tif", "c.exr.samples_4_5.state.tif"}, "x.exr", {"--quiet"}));
    EXPECT_FALSE(fs::exists(folder / "x.partial.exr"));
}

// Cut at every kilobyte, and with a bit turned at as many places: some bits of a TIFF's directory mean
// nothing.
TEST_F(Parts, ADamagedStateIsRefused) {
    const std::vector<std::string> small = {"--size", "8x6", "--spp", "2"};
    EXPECT_DONE(render("whole.exr", small));
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "0-0"})));
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "1-1"})));
    const std::string first = "a.exr.samples_0_0.state.tif", second = "a.exr.samples_1_1.state.tif",
                      good = read_file(folder / second);
    ASSERT_GT(good.size(), 4096U);
    const auto merged_to = [&](const std::string& picture) { // here: a process each would take its time
        const std::atomic<bool> never{false};
        std::atomic<size_t> added{0};
        try {
            merge_states({{folder / first, folder / second}, folder / picture, {}, false}, never, added);
        } catch (const InputError& error) {
            EXPECT_EQ(error.problems.size(), 1U);
            return std::string(error.what());
        }
        return std::string();
    };
    int refused = 0;
    for (size_t at = 0; at < good.size(); at += 1024) {
        folder.write(second, good.substr(0, at));
        EXPECT_CONTAINS(merged_to("x.exr"), folder / second + ": is damaged or cut short");
        std::string turned = good;
        turned[std::min(at + 100, good.size() - 1)] ^= 4;
        folder.write(second, turned);
        if (merged_to("y.exr").empty())
            expect_same("y.exr", "whole.exr");
        else
            ++refused;
    }
    EXPECT_GT(refused, 3);
    std::string other = good; // what it says of itself
    other[good.find("\"samples\":2") + 10] = '3';
    folder.write(second, other);
    EXPECT_CONTAINS(merged_to("x.exr"), folder / second + ": is damaged or cut short");
    std::string older = good;
    const size_t version = older.find("marram frame state 5");
    ASSERT_NE(version, std::string::npos);
    older[version + 19] = '4';
    folder.write(second, older);
    EXPECT_CONTAINS(merged_to("x.exr"), "is of another version of the program");
    EXPECT_FALSE(fs::exists(folder / "x.exr"));
    folder.write(second, good);
    EXPECT_EQ(merged_to("x.exr"), "");
    expect_same("x.exr", "whole.exr");
    // A damaged part is not taken for a finished one.
    std::string last = good;
    last.back() ^= 1;
    folder.write(second, last);
    EXPECT_CONTAINS(render("a.exr", with(small, {"--samples", "1-1", "--resume"})).err, "is damaged");
    EXPECT_EQ(merged_to("x.exr"), "");
}

TEST(FilmPart, WhatIsMissingIsWhatNoPartHas) {
    std::mt19937 random(3);
    const FilmPart whole{0, 0, 9, 7, 0, 8};
    const auto below = [&](uint32_t n) { return uint32_t(random() % n); };
    for (int trial = 0; trial < 300; ++trial) {
        std::vector<FilmPart> parts;
        for (int i = 0; i < 12; ++i) {
            FilmPart part{below(9), below(7), 0, 0, below(8), 0};
            part.x1 = part.x0 + 1 + below(9 - part.x0);
            part.y1 = part.y0 + 1 + below(7 - part.y0);
            part.end_sample = part.first_sample + 1 + below(8 - part.first_sample);
            if (std::ranges::none_of(parts, [&](const FilmPart& other) { return overlap(part, other); }))
                parts.push_back(part);
        }
        std::vector<FilmPart> all = missing_of(whole, parts);
        const std::vector<FilmPart> fewer = join_neighbours(parts);
        EXPECT_LE(fewer.size(), parts.size());
        all.insert(all.end(), fewer.begin(), fewer.end());
        uint64_t volume = 0;
        for (size_t i = 0; i < all.size(); ++i) {
            volume += uint64_t(all[i].width()) * all[i].height() * (all[i].end_sample - all[i].first_sample);
            for (size_t j = 0; j < i; ++j) EXPECT_FALSE(overlap(all[i], all[j]));
        }
        EXPECT_EQ(volume, 9U * 7U * 8U);
    }
    EXPECT_EQ(join_neighbours({{0, 0, 4, 4, 8, 16}, {0, 0, 4, 4, 0, 8}, {4, 0, 8, 4, 0, 16}}),
              (std::vector<FilmPart>{{0, 0, 8, 4, 0, 16}}));
}

// --samples-per-task: all ranges of a frame, which processes with --claim share; what --list says of them.
TEST_F(Parts, OfAFrameAreSharedAndListed) {
    const std::vector<std::string> small = {"--size", "16x12", "--spp", "10"},
                                   ranges = with(small, {"--samples-per-task", "4"});
    const auto list = [&] { return nlohmann::json::parse(render("a.exr", with(ranges, {"--list"})).out); };
    const std::vector<std::string> states = {"a.exr.samples_0_3.state.tif", "a.exr.samples_4_7.state.tif",
                                             "a.exr.samples_8_9.state.tif"};
    EXPECT_DONE(render("a.exr", with(small, {"--samples", "4-7"})));
    nlohmann::json frame = list();
    EXPECT_EQ(frame.at("there"), false);
    ASSERT_EQ(frame.at("parts").size(), 3u);
    for (size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(frame["parts"][i].at("state"), folder / states[i]);
        EXPECT_EQ(frame["parts"][i].at("there"), i == 1);
    }
    EXPECT_EQ(frame["parts"][2].at("samples"), "8-9");
    const ProgramResult others = render("a.exr", with(ranges, {"--claim"}));
    EXPECT_EQ(others.code, 0) << others.err;
    EXPECT_EQ(others.out, folder / states[0] + "\n" + folder / states[2] + "\n");
    EXPECT_EQ(list().at("there"), false) << "they are not merged";
    EXPECT_EQ(list()["parts"][0].at("there"), true);
    EXPECT_DONE(merge(states, "a.exr"));
    for (const std::string& state : states) fs::remove(folder / state);
    EXPECT_EQ(list().at("there"), true);
    EXPECT_EQ(list()["parts"][0].at("there"), true) << "the picture has it";
    EXPECT_DONE(render("whole.exr", small));
    expect_same("a.exr", "whole.exr");
    expect_refused(render("a.exr", with(ranges, {"--set", "film.noise=0.1"})), "add --set film.noise=0");
    expect_refused(render("a.exr", with(ranges, {"--samples", "0-3"})), "excludes");
}

} // namespace
} // namespace marram::testing
