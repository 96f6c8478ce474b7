// SPDX-License-Identifier: Apache-2.0
// Renders to a noise target and to a time limit.
#include "program.h"
#include "tests/whole.h"

#include <algorithm>
#include <cmath>

namespace marram::testing {
namespace {

const SceneText noisy_grass{.film = "size = [48, 32]\nsamples = 256\nmax_depth = 3\n",
                            .groom = "count = 3000\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n"};

double number_of(const std::string& path, const std::string& key) {
    return std::stod(read_metadata(path, key).value_or("nan"));
}

} // namespace

TEST(Noise, PixelsAreDoneWhenTheyAreAsGoodAsAskedFor) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", noisy_grass);
    constexpr double noise = 0.03;
    const auto rendered = [&](const std::string& name, const std::vector<std::string>& more) {
        std::vector<std::string> arguments = {"render", scene, "-o", folder / name, "--quiet"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        EXPECT_DONE(marram(arguments));
        return folder / name;
    };
    const std::string target = "film.noise=" + std::to_string(noise);
    const std::string adaptive = rendered("a.exr", {"--set", target});
    const std::string other_threads = rendered("b.exr", {"--set", target, "--threads", "1"});
    const std::string finest = rendered("c.exr", {"--spp", "4096", "--set", "film.seed=3"});
    EXPECT_TRUE(same_picture(adaptive, other_threads)) << "who is done does not depend on threads";
    const double mean_samples = number_of(adaptive, "marram:mean_samples");
    EXPECT_LT(mean_samples, 200.0);
    EXPECT_GE(mean_samples, 16.0);
    const Image a = read_image(adaptive), b = read_image(finest);
    const auto luminance = [](const Image& image, size_t pixel) {
        const auto channel = [&](const char* name) {
            const auto at = std::ranges::find(image.channel_names, name) - image.channel_names.begin();
            return double(image.pixels[pixel * size_t(image.channels) + size_t(at)]);
        };
        return 0.2126 * channel("R") + 0.7152 * channel("G") + 0.0722 * channel("B");
    };
    double mean = 0.0;
    constexpr size_t pixels = 48 * 32;
    for (size_t i = 0; i < pixels; ++i) mean += luminance(b, i) / double(pixels);
    double squares = 0.0;
    size_t beyond = 0;
    for (size_t i = 0; i < pixels; ++i) {
        const double off =
            (luminance(a, i) - luminance(b, i)) / std::max(luminance(b, i), 0.1 * mean) / noise;
        squares += off * off / double(pixels);
        beyond += std::abs(off) > 3.0;
    }
    std::printf("%.0f samples a pixel of 256; off by %.2f of the noise asked for (rms), %zu pixels of %zu by "
                "more than three times\n",
                mean_samples, std::sqrt(squares), beyond, pixels);
    EXPECT_LT(std::sqrt(squares), 1.1);
    EXPECT_LT(beyond, pixels / 50);
}

// Stratification removes most of the noise that single samples show at edges and in soft shadows: no samples
// are spent on it.
TEST(Noise, StrataCount) {
    const Folder folder;
    const auto rendered = [&](const std::string& name, const char* more, const char* value) {
        EXPECT_DONE(
            marram({"render", MARRAM_SOURCE_DIR "/scenes/golden/room.toml", "-o", folder / name, "--quiet",
                    "--size", "96x64", "--spp", "1024", "--set", std::string(more) + value}));
        return read_image(folder / name);
    };
    const Image finest = rendered("a.exr", "film.seed=", "5"),
                image = rendered("b.exr", "film.noise=", "0.03");
    const auto green = [](const Image& of, size_t pixel) {
        const auto at = std::ranges::find(of.channel_names, "G") - of.channel_names.begin();
        return double(of.pixels[pixel * size_t(of.channels) + size_t(at)]);
    };
    constexpr size_t pixels = 96 * 64;
    double mean = 0.0, squares = 0.0;
    for (size_t i = 0; i < pixels; ++i) mean += green(finest, i) / double(pixels);
    for (size_t i = 0; i < pixels; ++i) {
        const double there = green(finest, i),
                     off = (green(image, i) - there) / std::max(there, 0.1 * mean) / 0.03;
        squares += off * off / double(pixels);
    }
    const double samples = number_of(folder / "b.exr", "marram:mean_samples");
    std::printf("a room: %.0f samples a pixel of 1024; off by %.2f of the noise asked for (rms)\n", samples,
                std::sqrt(squares));
    EXPECT_LT(samples, 160.0); // 314 if single samples were used
    EXPECT_LT(std::sqrt(squares), 1.0);
}

// A lamp in the picture does not cause noise in the rest of it.
TEST(Noise, TargetHoldsBesideWhatShines) {
    const Folder folder;
    const std::string lamp = "[[light]]\nname = \"lamp\"\ntype = \"mesh\"\nmesh = \"bulb\"\n"
                             "radiance = [9e4, 9e4, 9e4]\n[[mesh]]\nname = \"bulb\"\ntype = \"sphere\"\n"
                             "radius = 0.02\ntransform = { translate = [0, 1.2, 0] }\n";
    const std::string scene =
        folder.write("a.toml", SceneText{.film = noisy_grass.film, .groom = noisy_grass.groom, .more = lamp});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--set", "film.noise=0.05",
                        "--spp", "4096", "--aov", "variance"}));
    const Image image = read_image(folder / "a.exr");
    const auto channel = [&](const char* name) {
        return size_t(std::ranges::find(image.channel_names, name) - image.channel_names.begin());
    };
    const size_t green = channel("G"), variance = channel("variance.G");
    std::vector<double> deviations;
    for (size_t i = 0; i < image.pixels.size(); i += size_t(image.channels))
        deviations.push_back(std::sqrt(double(image.pixels[i + variance])) / double(image.pixels[i + green]));
    std::ranges::sort(deviations);
    const double most = deviations[deviations.size() * 9 / 10];
    std::printf("beside a lamp nine pixels in ten are within %.3f, 0.05 was asked for\n", most);
    EXPECT_LT(most, 0.08);
}

// The samples of the picture also decide when a pixel stops: pixels that miss rare bright paths stop early.
// Measures how much this darkens fur with much multiple scattering.
TEST(Noise, TargetDarkensLittle) {
    const Folder folder;
    double with = 0.0, without = 0.0;
    for (int seed = 1; seed <= (whole_run() ? 3 : 1); ++seed)
        for (const char* noise : {"0", "0.1"}) {
            EXPECT_DONE(
                marram({"render", MARRAM_SOURCE_DIR "/scenes/golden/fur.toml", "-o", folder / "a.exr",
                        "--quiet", "--frame", "20", "--size", "64x48", "--spp", "256", "--set",
                        fmt::format("film.seed={}", seed), "--set", fmt::format("film.noise={}", noise),
                        "--set", "procedural.fur.material=\"hair\"", "--set", "film.max_depth=8"}));
            const Image image = read_image(folder / "a.exr");
            const auto red =
                size_t(std::ranges::find(image.channel_names, "R") - image.channel_names.begin());
            double sum = 0.0;
            for (size_t i = red; i < image.pixels.size(); i += size_t(image.channels))
                sum += double(image.pixels[i]);
            (std::string(noise) == "0" ? without : with) += sum;
        }
    std::printf("a target of 0.1: %.3f %% darker\n", 100.0 * (1.0 - with / without));
    EXPECT_NEAR(with / without, 1.0, 0.003);
}

// The reported loss by clamping is what the picture lacks.
TEST(Noise, ClampSaysWhatItTakes) {
    const Folder folder;
    const auto rendered = [&](const std::string& name, const char* clamp) {
        const ProgramResult outcome =
            marram({"render", MARRAM_SOURCE_DIR "/scenes/golden/fur.toml", "-o", folder / name, "--frame",
                    "20", "--size", "64x48", "--spp", "64", "--set", fmt::format("film.clamp={}", clamp),
                    "--set", "procedural.fur.material=\"hair\"", "--set", "film.max_depth=8", "--stats",
                    folder / (name + ".json")});
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        const std::string stats = read_file(folder / (name + ".json"));
        const std::string key = "\"clamped\": ";
        const size_t at = stats.find(key);
        EXPECT_NE(at, std::string::npos) << stats;
        return std::pair(outcome.err,
                         at == std::string::npos ? -1.0 : std::stod(stats.substr(at + key.size())));
    };
    const auto brightness = [&](const std::string& name) {
        const Image image = read_image(folder / name);
        double sum = 0.0;
        for (size_t i = 0; i < image.pixels.size(); i += size_t(image.channels))
            for (size_t c = 0; c < size_t(image.channels); ++c) {
                const std::string& channel = image.channel_names[c];
                sum += double(image.pixels[i + c]) * (channel == "R"   ? 0.2126
                                                      : channel == "G" ? 0.7152
                                                      : channel == "B" ? 0.0722
                                                                       : 0.0);
            }
        return sum;
    };
    const auto [plain_text, plain_share] = rendered("plain.exr", "0");
    EXPECT_EQ(plain_text, "");
    EXPECT_EQ(plain_share, 0.0);
    const auto [text, share] = rendered("clamped.exr", "0.5");
    EXPECT_CONTAINS(text, fmt::format("film.clamp took {:.2g} % of the light", 100.0 * share));
    const double missing = 1.0 - brightness("clamped.exr") / brightness("plain.exr");
    std::printf("[ clamp ] %.3f %% taken, %.3f %% missing\n", 100.0 * share, 100.0 * missing);
    EXPECT_GT(share, 1e-3);
    EXPECT_NEAR(missing, share, 0.3 * share); // filter weights vary, and shadow rays differ
}

// EXR files hold halfs if these can represent the picture, otherwise floats.
TEST(Noise, DimPicturesLoseNothingWhenTheyAreSaved) {
    const Folder folder;
    const auto mean = [&](const char* strength) {
        EXPECT_DONE(
            marram({"render", MARRAM_SOURCE_DIR "/scenes/golden/room.toml", "-o", folder / "a.exr", "--quiet",
                    "--size", "48x36", "--spp", "16", "--set", fmt::format("light.sky.strength={}", strength),
                    "--set", "light.sun.irradiance=[0, 0, 0]", "--aov", "variance"}));
        const Image image = read_image(folder / "a.exr");
        EXPECT_EQ(image.half, std::string(strength) == "1");
        double sum = 0.0;
        for (size_t i = 0; i < image.pixels.size(); i += size_t(image.channels))
            sum += double(image.pixels[i]);
        return sum;
    };
    const double bright = mean("1");
    EXPECT_NEAR(mean("1e-6") / bright, 1e-6, 1e-9);
    EXPECT_NEAR(mean("1e6") / bright, 1e6, 1e3);
}

// However short the time, the result is a picture with fewer samples.
TEST(Noise, TimeIsKeptByFewerSamples) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", noisy_grass);
    const ProgramResult done =
        marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--spp", "65536", "--seconds", "0.05"});
    EXPECT_EQ(done.code, 0);
    EXPECT_CONTAINS(done.err, "time was up after ");
    const double samples = number_of(folder / "a.exr", "marram:samples");
    ASSERT_GE(samples, 1.0);
    ASSERT_LT(samples, 65536.0);
    const double mean = number_of(folder / "a.exr", "marram:mean_samples");
    EXPECT_GE(mean, samples - 16.0)
        << "pixels differ by less than a pass"; // by one: Resume.UsesTheTimeThatItIsGiven
    EXPECT_LE(mean, samples);
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:digest"), "partial") << "--resume goes on with it";
    const std::string more = fmt::format("{:.0f}", samples + 3.0);
    EXPECT_EQ(marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--spp", more, "--resume"}).code,
              0);
    EXPECT_DONE(marram({"render", scene, "-o", folder / "b.exr", "--quiet", "--spp", more}));
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr"));
    EXPECT_EQ(marram({"render", scene, "-o", folder / "c.exr", "--quiet", "--seconds", "0"}).code, 2);
}

} // namespace marram::testing
