// SPDX-License-Identifier: Apache-2.0
// `marram render --png`: a layer as a separate picture, beside an EXR or a PNG.
#include "program.h"

#include "core/image/picture.h"
#include "core/shot/layer_picture.h"

#include <cmath>

namespace marram::testing {
namespace {

TEST(LayerPictures, AreReadFromTheCommandLine) {
    const auto same = [](const LayerPicture& picture, const std::string& layer,
                         std::optional<ValueRange> range, const std::string& file) {
        return picture.layer == layer && picture.range == range && picture.file == file;
    };
    EXPECT_TRUE(same(parse_layer_picture("depth:0-20=d.png"), "depth", ValueRange{0, 20}, "d.png"));
    EXPECT_TRUE(same(parse_layer_picture("depth:20-0.5=d.png"), "depth", ValueRange{20, 0.5}, "d.png"));
    EXPECT_TRUE(
        same(parse_layer_picture("normal:-1--0.5=a=b:c.png"), "normal", ValueRange{-1, -0.5}, "a=b:c.png"));
    EXPECT_TRUE(same(parse_layer_picture("a:b:1e-3-1e3=f.png"), "a:b", ValueRange{1e-3, 1e3}, "f.png"));
    EXPECT_TRUE(same(parse_layer_picture("normal=n.png"), "normal", std::nullopt, "n.png"));
    const std::map<std::string, std::string> refused = {
        {"depth", "--png depth:1:6: the file is missing"},
        {"depth:0-20", ":1:11: the file is missing"},
        {"depth:0-20=", ":1:12: the file is missing"},
        {"", ":1:1: the file is missing"},
        {"=a.png", ":1:1: the layer is missing"},
        {":0-1=a.png", ":1:1: the layer is missing"},
        {"depth:=a.png", ":1:7: '' is no range of values"},
        {"depth:0=a.png", ":1:7: '0' is no range of values"},
        {"depth:1-1=a.png", ":1:7: '1-1' is no range of values"},
        {"depth:0-x=a.png", ":1:7: '0-x' is no range of values"},
        {"depth:0-inf=a.png", ":1:7: '0-inf' is no range of values"},
        {"depth:0-1 =a.png", ":1:7: '0-1 ' is no range of values"},
    };
    for (const auto& [text, message] : refused) {
        std::string said;
        try {
            parse_layer_picture(text);
        } catch (const InputError& error) {
            said = error.what();
        }
        EXPECT_CONTAINS(said, message);
    }
}

const SceneText small{.film = "size = [24, 16]\nsamples = 2\nmax_depth = 1\n"};

// Compares each pixel of a picture with the layer in an EXR of the same frame.
void expect_layer(const std::string& exr, const std::string& layer, const std::string& png, ValueRange range,
                  bool depth = false) {
    const Picture picture = read_picture(exr);
    const Picture::Layer* values = picture.find(layer);
    ASSERT_TRUE(values) << layer;
    const Image image = read_image(png, ColorSpace::linear_data);
    ASSERT_EQ(image.pixels.size(), values->pixels.size()) << png;
    double brightest = 0.0, darkest = 1.0;
    for (size_t i = 0; i < image.pixels.size(); ++i) {
        const double value = double(values->pixels[i]);
        double expected = std::clamp((value - range.black) / (range.white - range.black), 0.0, 1.0);
        // The background is farthest.
        if (depth && value == 0.0) expected = range.white > range.black ? 1.0 : 0.0;
        ASSERT_NEAR(double(image.pixels[i]), expected, 1e-3) << png << " value " << i; // an EXR holds halfs
        brightest = std::max(brightest, double(image.pixels[i]));
        darkest = std::min(darkest, double(image.pixels[i]));
    }
    EXPECT_GT(brightest, darkest + 0.1) << png << " shows something";
}

TEST(LayerPictures, HoldTheLayersValues) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", small);
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--png", "depth:2-6=" + folder / "depth.png",
                        "--png", "depth:6-2=" + folder / "near.png", "--png",
                        "normal=" + folder / "normal.png", "--png", "envelope:0-2=" + folder / "envelope.png",
                        "--png", "alpha=" + folder / "alpha.png"}));
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr", "a.toml", "alpha.png", "depth.png",
                                                     "envelope.png", "near.png", "normal.png"}));
    expect_layer(folder / "a.exr", "depth", folder / "depth.png", {2, 6}, true);
    expect_layer(folder / "a.exr", "depth", folder / "near.png", {6, 2}, true);
    expect_layer(folder / "a.exr", "normal", folder / "normal.png", {-1, 1});
    expect_layer(folder / "a.exr", "envelope", folder / "envelope.png", {0, 2});
    expect_layer(folder / "a.exr", "alpha", folder / "alpha.png", {0, 1});
    EXPECT_EQ(read_metadata(folder / "depth.png", "marram:layer"), "depth 2 6");
    EXPECT_EQ(read_metadata(folder / "depth.png", "marram:frame"), "1");
}

// Colours look as in the picture. A PNG needs no --aov, and the picture itself does not change.
TEST(LayerPictures, StandBesideAPng) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{.film = small.film + "exposure = 1\n"});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.png"}));
    EXPECT_DONE(
        marram({"render", scene, "-o", folder / "b.png", "--png", "beauty=" + folder / "beauty.png", "--png",
                "beauty:0-0.5=" + folder / "bright.png", "--png", "depth:0-9=" + folder / "depth.png"}));
    EXPECT_TRUE(same_picture(folder / "a.png", folder / "b.png"));
    EXPECT_TRUE(same_picture(folder / "a.png", folder / "beauty.png"));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "c.png", "--set", "film.exposure=2"}));
    EXPECT_TRUE(same_picture(folder / "c.png", folder / "bright.png")) << "half the range is a stop";
}

TEST(LayerPictures, AreNumberedAndResumed) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", small);
    const std::vector<std::string> command = {
        "render",   scene,   "-o",    folder / "f.##.exr",
        "--frames", "1-3x2", "--png", "depth:0-9=" + folder / "d.##.png"};
    const ProgramResult done = marram(command);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(lines(done.out), (std::vector<std::string>{folder / "d.01.png", folder / "f.01.exr",
                                                         folder / "d.03.png", folder / "f.03.exr"}));
    const auto resume = [&](std::vector<std::string> words) {
        words.emplace_back("--resume");
        const ProgramResult resumed = marram(words);
        EXPECT_EQ(resumed.code, 0) << resumed.err;
        return lines(resumed.out);
    };
    EXPECT_EQ(resume(command).size(), 0u) << "all is there";
    fs::remove(folder / "d.03.png");
    EXPECT_EQ(resume(command), (std::vector<std::string>{folder / "d.03.png", folder / "f.03.exr"}));
    std::vector<std::string> other = command;
    other.back() = "depth:0-8=" + folder / "d.##.png";
    EXPECT_EQ(resume(other).size(), 4u) << "another range is another picture";
}

// An interrupted frame writes no layer pictures until it is complete.
TEST(LayerPictures, WaitForTheWholeFrame) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", small);
    const std::vector<std::string> command = {
        "render", scene, "-o", folder / "a.exr", "--png", "depth:0-9=" + folder / "d.png", "--spp"};
    std::vector<std::string> endless = command;
    endless.emplace_back("65536");
    EXPECT_EQ(interrupt_in("rendering", endless), 130);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", "a.exr.state.tif", "a.partial.exr"}));
    std::vector<std::string> timed = endless;
    timed.insert(timed.end(), {"--seconds", "0.001", "--quiet"});
    EXPECT_EQ(marram(timed).code, 0);
    EXPECT_EQ(read_metadata(folder / "d.png", "marram:digest"), "partial") << "as the picture beside it";
}

TEST(LayerPictures, AreRefusedBeforeAnythingIsWritten) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", small);
    const auto before = folder.contents();
    const auto refuse = [&](std::vector<std::string> more, const std::string& message) {
        more.insert(more.begin(), {"render", scene, "-o", folder / "a.exr"});
        const ProgramResult refused = marram(more, run_copy);
        EXPECT_EQ(refused.code, 2);
        EXPECT_EQ(lines(refused.err).size(), 1u) << refused.err;
        EXPECT_CONTAINS(refused.err, message);
        EXPECT_TRUE(folder.contents() == before);
    };
    refuse({"--png", "depht:0-1=" + folder / "d.png"}, "--png depht: this scene has no image layer 'depht': "
                                                       "choose among albedo, alpha, beauty, contact, depth");
    refuse({"--png", "depth=" + folder / "d.png"},
           "--png depth: this layer has no range of its own: say which values");
    refuse({"--png", "depth:0-1=" + folder / "d.exr"}, "--png writes no other format: name it .png");
    refuse({"--png", "depth:0-1=" + folder / "a.toml.png", "--png", "normal=" + folder / "a.toml.png"},
           "this would overwrite");
    refuse({"--png", "depth:0-1=" + folder / "no/d.png"}, "does not exist");
    refuse({"--png", "depth:0-1=" + folder / "d.png", "-o", folder / "a.#.exr", "--frames", "1-2"},
           "all frames would go to one file");
    refuse({"--png", "depth:0-1"}, "--png depth:0-1:1:10: the file is missing");
    refuse({"--png", "depth:0-1=" + folder / "d.png", "-o", folder / "a.png", "--aov", "normal"},
           "or the layer to a file of its own with --png");
}

// A scene's film.aovs go to EXR only. That a PNG lacks them is said.
TEST(LayerPictures, OfTheSceneAreMissedInAPng) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.film = std::string(small.film) + "aovs = [\"normal\", \"depth\"]\n"});
    const auto messages = [&](std::vector<std::string> more) {
        more.insert(more.begin(), {"render", scene, "--quiet", "-o"});
        const ProgramResult done = marram(more, run_copy);
        EXPECT_EQ(done.code, 0);
        return lines(done.err);
    };
    EXPECT_EQ(messages({folder / "a.exr"}).size(), 0u);
    const auto png = messages({folder / "a.png", "--png", "normal=" + folder / "n.png"});
    ASSERT_EQ(png.size(), 1u);
    EXPECT_CONTAINS(png[0], "film.aovs: not written: depth: a PNG holds the picture alone");
}

} // namespace
} // namespace marram::testing
