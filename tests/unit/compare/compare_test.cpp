// SPDX-License-Identifier: Apache-2.0
// Which differences comparison must find and which it must ignore, on synthetic pictures with known noise.
#include "core/compare/compare.h"

#include "core/compare/flip.h"
#include "core/math/hash.h"
#include "core/math/problem.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>

#include <unistd.h>

namespace marram {
namespace {

std::string why(const Comparison& c) { return c.faults.empty() ? c.doubt : c.faults.front(); }

constexpr int width = 96, height = 64;

// A standard normal number.
double normal(uint64_t seed, uint64_t i) {
    const uint64_t h = hash(seed, i);
    const double u = (double(h >> 40) + 0.5) * 0x1p-24, v = double(h & 0xffffff) * 0x1p-24;
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * 3.14159265358979 * v);
}

// A smooth picture with an edge, plus noise and `add`.
Picture made(
    uint64_t seed, double noise,
    const std::function<double(int, int, int)>& add = [](int, int, int) { return 0.0; }) {
    Picture picture{width, height, 64, "", {{"", {"R", "G", "B"}, {}}, {"variance", {"R", "G", "B"}, {}}}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < 3; ++c) {
                const double base = (x > y ? 0.6 : 0.2) + 0.1 * std::sin(0.1 * x) + 0.05 * c;
                const auto at = uint64_t((y * width + x) * 3 + c);
                picture.layers[0].pixels.push_back(float(base + noise * normal(seed, at) + add(x, y, c)));
                picture.layers[1].pixels.push_back(float(noise * noise));
            }
    return picture;
}

Comparison compared(const Picture& a, const Picture& b) { return compare_pictures(a, b, "a", "b"); }

Picture without_variance(Picture picture) {
    picture.layers.pop_back();
    return picture;
}

} // namespace

TEST(Compare, TheLimitIsStudentsT) {
    EXPECT_NEAR(student_limit(0.001, 10.0), 4.587, 0.014); // from tables, two-sided
    EXPECT_NEAR(student_limit(0.001, 30.0), 3.646, 0.005);
    EXPECT_NEAR(student_limit(0.01, 20.0), 2.845, 0.005);
    EXPECT_NEAR(student_limit(0.001, 1e9), 3.2905, 0.001);
    EXPECT_NEAR(student_limit(1e-9, 1e9), 6.1094, 0.001);
}

TEST(Compare, NoiseOfAnotherSeedIsAlike) {
    constexpr double noise =
        0.012; // weak enough to look alike: then noise cannot hide much, and nothing else is asked
    const Picture reference = made(1, noise);
    int alarms = 0;
    double whole = 0.0;
    constexpr int seeds = 200;
    for (int i = 0; i < seeds; ++i) {
        const Comparison c = compared(made(uint64_t(2 + i), noise), reference);
        EXPECT_TRUE(c.has_noise_estimate);
        EXPECT_FALSE(c.equal);
        alarms += !c.alike();
        whole += c.scales.back().worst;
    }
    EXPECT_LE(alarms, 1) << "the level is 0.001";
    // The worst of three channels has a mean of about 1.3 standard deviations; all seeds share a reference.
    EXPECT_GT(whole / seeds, 0.3);
    EXPECT_LT(whole / seeds, 2.0);
}

TEST(Compare, SmallSteadyDifferencesAddUp) {
    const Picture reference = made(1, 0.05);
    // A twentieth of a standard deviation everywhere; half of one in a square; twenty in a pixel.
    const Comparison all = compared(made(2, 0.05, [](int, int, int) { return 0.005; }), reference);
    EXPECT_FALSE(all.alike());
    EXPECT_EQ(all.worst_scale()->size, 0);
    const Comparison square = compared(
        made(2, 0.05, [](int x, int y, int) { return x >= 32 && x < 48 && y >= 16 && y < 32 ? 0.05 : 0.0; }),
        reference);
    EXPECT_FALSE(square.alike());
    EXPECT_EQ(square.worst_scale()->size, 16);
    EXPECT_EQ(square.worst_scale()->x, 32);
    EXPECT_EQ(square.worst_scale()->y, 16);
    const Comparison pixel =
        compared(made(2, 0.05, [](int x, int y, int) { return x == 7 && y == 9 ? 1.0 : 0.0; }), reference);
    EXPECT_FALSE(pixel.alike());
    EXPECT_EQ(pixel.worst_scale()->size, 1);
    EXPECT_EQ(pixel.worst_scale()->x, 7);
}

// A difference of 0.6 standard deviations in each pixel, with any sign: no square is off by much.
TEST(Compare, SmallDifferencesEverywhereAreFound) {
    const auto rough = [](double by) {
        return made(2, 0.05, [=](int x, int y, int c) {
            return hash(7, uint64_t(3 * (y * width + x) + c)) % 2 == 0 ? by : -by;
        });
    };
    const Picture reference = made(1, 0.05);
    const Comparison same = compared(rough(0.0), reference),
                     other = compared(rough(0.03 * std::sqrt(2.0)), reference);
    EXPECT_TRUE(same.alike());
    ASSERT_EQ(same.ratios.size(), 5U);
    for (const RatioResult& ratio : same.ratios) EXPECT_NEAR(ratio.ratio, 1.0, 0.3) << ratio.size;
    EXPECT_TRUE(std::ranges::none_of(other.scales, &ScaleResult::fails));
    ASSERT_EQ(other.faults.size(), 1U);
    EXPECT_NE(other.faults[0].find("squared differences of pixels are 1.3"), std::string::npos)
        << other.faults[0];
}

// Where noise could hide a difference that people would see, the pictures are neither alike nor different;
// with the samples that the message asks for they are alike.
TEST(Compare, NoiseThatCouldHideADifferenceIsSaid) {
    constexpr double noise = 0.2;
    const Comparison c = compared(made(2, noise), made(1, noise));
    EXPECT_FALSE(c.different());
    EXPECT_FALSE(c.alike());
    const size_t words = c.doubt.find("render both with about ");
    ASSERT_NE(words, std::string::npos) << c.doubt;
    const int samples = std::atoi(c.doubt.c_str() + words + 23);
    EXPECT_GT(samples, 64) << c.doubt;
    EXPECT_LT(samples, 64000) << c.doubt;
    const double less = noise * std::sqrt(64.0 / samples);
    EXPECT_TRUE(compared(made(2, less), made(1, less)).alike());
    EXPECT_FALSE(compared(made(1, noise), made(1, noise)).doubt.size()) << "every number is the same";
    EXPECT_TRUE(compared(made(2, noise, [](int, int, int) { return 0.1; }), made(1, noise)).different());
    // What noise cannot hide: the deviation of a mean, of one pixel and of 96 x 64.
    EXPECT_NEAR(c.scales.front().deviation, noise * std::sqrt(2.0), 1e-6);
    EXPECT_NEAR(c.scales.back().deviation, noise * std::sqrt(2.0 / (width * height)), 1e-6);
}

TEST(Compare, WithoutVarianceLooksDecide) {
    const Picture reference = without_variance(made(1, 0.002));
    EXPECT_TRUE(compared(reference, reference).equal);
    EXPECT_TRUE(compared(reference, reference).alike());
    EXPECT_TRUE(compared(without_variance(made(2, 0.002)), reference).alike());
    const Comparison off = compared(
        without_variance(made(1, 0.002, [](int x, int, int) { return x > 60 ? 0.2 : 0.0; })), reference);
    EXPECT_FALSE(off.alike());
    EXPECT_FALSE(off.has_noise_estimate);
}

// 400 pixels of 76,800: too few for means and for the 99th percentile.
TEST(Compare, WithoutVarianceASmallThingIsMissed) {
    constexpr int w = 320, h = 240;
    const auto with_square = [](float r, float g, float b) {
        Picture picture{w, h, 64, "", {{"", {"R", "G", "B"}, {}}}};
        for (int y = 0; y < h; ++y)
            for (int x = 0; x < w; ++x) {
                const float base = 0.2F + 0.1F * float(x) / w;
                const bool in = x >= 100 && x < 120 && y >= 60 && y < 80;
                for (const float v : {r, g, b}) picture.layers[0].pixels.push_back(in ? v : base);
            }
        return picture;
    };
    for (const bool display : {false, true})
        for (const float red : {0.5F, 0.0F}) {
            Picture with = with_square(red, 0.0F, 0.0F), without = with_square(0.23F, 0.23F, 0.23F);
            with.display = without.display = display;
            const Comparison c = compared(without, with);
            ASSERT_EQ(c.faults.size(), 1U) << red;
            EXPECT_NE(c.faults[0].find("it looks different: mean FLIP of 16 x 16 pixels at (104, 64) 0."),
                      std::string::npos)
                << c.faults[0];
            EXPECT_GT(c.flip_window, c.flip_window_limit);
            EXPECT_EQ(c.flip_window_x, 104);
            EXPECT_EQ(c.flip_window_y, 64);
        }
    EXPECT_TRUE(std::isinf(compared(made(2, 0.05), made(1, 0.05)).flip_window_limit))
        << "a test of the noise decides";
}

TEST(Compare, WithoutVarianceLightBelowZeroIsSeen) {
    const auto scaled = [](float by) {
        Picture picture = without_variance(made(1, 0.0));
        for (float& v : picture.layers[0].pixels) v *= by;
        return picture;
    };
    EXPECT_FALSE(compared(scaled(-1.0F), scaled(0.0F)).alike());
    EXPECT_FALSE(compared(scaled(0.0F), scaled(-1.0F)).alike());
    EXPECT_TRUE(compared(scaled(-1.0F), scaled(-1.0F)).alike());
    EXPECT_TRUE(compared(scaled(0.0F), scaled(0.0F)).alike());
}

TEST(Compare, TheVerdictNamesTheChannel) {
    const Comparison c = compared(
        made(2, 0.05, [](int, int, int channel) { return channel == 1 ? 0.02 : 0.0; }), made(1, 0.05));
    ASSERT_FALSE(c.alike());
    EXPECT_NE(c.faults[0].find("the whole picture is off in green by "), std::string::npos) << c.faults[0];
}

// Accepted, but with a note.
TEST(Compare, MuchMoreNoiseIsNoted) {
    EXPECT_TRUE(compared(made(2, 0.005), made(1, 0.005)).notes.empty());
    EXPECT_TRUE(compared(made(2, 0.009), made(1, 0.005)).notes.empty());
    const Comparison c = compared(made(2, 0.015), made(1, 0.005));
    EXPECT_TRUE(c.alike());
    ASSERT_EQ(c.notes.size(), 1U);
    EXPECT_NE(c.notes[0].find("the mean variance of A is 9 times that of B"), std::string::npos)
        << c.notes[0];
    EXPECT_TRUE(compared(without_variance(made(2, 0.015)), made(1, 0.005)).notes.empty())
        << "it says nothing";
}

TEST(Compare, OneVarianceServesBoth) {
    const Picture reference = made(1, 0.05);
    const Comparison c = compared(without_variance(made(2, 0.05)), reference);
    EXPECT_TRUE(c.has_noise_estimate);
    EXPECT_TRUE(c.alike());
}

// The picture has a variance but no sample count: at least two are assumed.
TEST(Compare, UnknownSamplesDoNotHideAFault) {
    Picture reference = made(1, 0.05), seed = made(2, 0.05), bright = made(3, 0.05);
    for (float& v : bright.layers[0].pixels) v *= 1.2F;
    for (Picture* picture : {&reference, &seed, &bright}) picture->samples = 0;
    EXPECT_TRUE(compared(seed, reference).alike());
    const Comparison c = compared(bright, reference);
    EXPECT_FALSE(c.alike());
    EXPECT_LT(c.scales.back().limit, 5.6) << "of 6,144 pixels the mean is well known";
    EXPECT_FALSE(compared(without_variance(seed), reference).has_noise_estimate);
    EXPECT_NE(compared(without_variance(seed), reference).unknown.find("only one picture has"),
              std::string::npos);
}

// Ids where several strands share a pixel: another seed finds others of them, but no strand that is not
// there. More than half of the picture is background.
TEST(Compare, NamesAreNoQuantities) {
    const auto ids = [](uint64_t seed, float first, int moved = 0, const char* name = "id") {
        Picture picture = without_variance(made(1, 0.0));
        Picture::Layer layer{name, {"Y"}, {}};
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) { // slanted strands, three to a pixel
                const auto at = uint64_t(y * width + x);
                const uint64_t strand = uint64_t(3 * (x + moved + y / 4)) + hash(seed, at) % 3;
                layer.pixels.push_back(x < width * 9 / 20 ? first + float(hash(7, strand) & 0xfffff) : 0.0F);
            }
        picture.layers.push_back(layer);
        return picture;
    };
    EXPECT_TRUE(compared(ids(1, 0.0F), ids(2, 0.0F)).alike());
    EXPECT_GT(compared(ids(1, 0.0F), ids(2, 0.0F)).layers.back().mean,
              0.1 * compared(ids(1, 0.0F), ids(2, 0.0F)).layers.back().range);
    EXPECT_FALSE(compared(ids(1, 1.0F), ids(1, 0.0F)).alike()) << "every strand has another name";
    EXPECT_FALSE(compared(ids(1, 0.0F), ids(2, 0.0F, 1)).alike()) << "moved";
    EXPECT_TRUE(compared(ids(1, 0.0F, 0, "objectID"), ids(2, 0.0F, 0, "objectID")).alike());
    EXPECT_FALSE(compared(ids(1, 1.0F, 0, "objectID"), ids(1, 0.0F, 0, "objectID")).alike());
    const auto depth = [](float upper, const char* name) { // whole numbers with another name are quantities
        Picture picture = without_variance(made(1, 0.0));
        Picture::Layer layer{name, {"Z"}, std::vector<float>(size_t(width * height), 0.0F)};
        std::fill_n(layer.pixels.begin(), width * height / 2, upper);
        picture.layers.push_back(layer);
        return picture;
    };
    for (const char* name : {"depth", "fluid"}) {
        EXPECT_TRUE(compared(depth(101.0F, name), depth(100.0F, name)).alike());
        EXPECT_FALSE(compared(depth(2.0F, name), depth(3.0F, name)).alike());
    }
}

// If every pixel is an edge, two seeds differ by more than 0.03. A layer with an offset also does, and is
// different.
TEST(Compare, LayersMayBeNoisyButNotOff) {
    const auto along = [](uint64_t seed, double add) {
        Picture picture = without_variance(made(1, 0.0));
        Picture::Layer layer{"strand_u", {"Y"}, {}};
        for (int i = 0; i < width * height; ++i)
            layer.pixels.push_back(
                float(0.1 + 0.8 * double(i % 5) / 4.0 + add + 0.06 * normal(seed, uint64_t(i))));
        picture.layers.push_back(layer);
        return picture;
    };
    const Comparison seeds = compared(along(1, 0.0), along(2, 0.0));
    EXPECT_GT(seeds.layers.back().mean, 0.06 * seeds.layers.back().range);
    EXPECT_TRUE(seeds.alike());
    EXPECT_FALSE(compared(along(1, 0.03), along(2, 0.0)).alike());

    // A chequered layer is everywhere close to its inverse, and noise that is the same for both is close to
    // itself when moved.
    const auto chequered = [](int odd, int moved) {
        Picture picture = without_variance(made(1, 0.0));
        Picture::Layer chequers{"normal", {"X"}, {}}, rough{"depth", {"Z"}, {}};
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                chequers.pixels.push_back(float((x + y + odd) % 2));
                rough.pixels.push_back(float(1.0 + 0.2 * normal(9, uint64_t(y * 1000 + x + moved))));
            }
        picture.layers.push_back(chequers);
        picture.layers.push_back(rough);
        return picture;
    };
    EXPECT_TRUE(compared(chequered(0, 0), chequered(0, 0)).alike());
    EXPECT_EQ(compared(chequered(1, 0), chequered(0, 0)).faults.size(), 1U);
    EXPECT_EQ(compared(chequered(0, 1), chequered(0, 0)).faults.size(), 1U);
}

TEST(Compare, GreyIsNotColour) {
    Picture colour = without_variance(made(1, 0.0)), grey = colour;
    grey.grey = true;
    EXPECT_THROW(compared(grey, colour), InputError);
    EXPECT_TRUE(compared(grey, grey).equal);
}

TEST(Compare, NumbersAreWhatTheySay) {
    Picture a = without_variance(made(1, 0.0)), b = a;
    for (float& v : a.layers[0].pixels) v += 0.25F;
    const Comparison c = compared(a, b);
    EXPECT_NEAR(c.layers[0].rmse, 0.25, 1e-6);
    EXPECT_NEAR(c.layers[0].psnr, 20.0 * std::log10(1.0 / 0.25), 1e-4);
    EXPECT_NEAR(c.layers[0].most, 0.25, 1e-6);
    EXPECT_EQ(compared(b, b).ssim, 1.0);
}

TEST(Compare, GoldenLimitsAreKept) {
    Picture reference = made(1, 0.05);
    reference.limits = to_text({{{1, 3.0}, {0, 2.5}}, 0.5, 0.9, 0.2});
    const std::optional<Limits> read = limits_from(reference.limits);
    ASSERT_TRUE(read.has_value());
    EXPECT_EQ(read->deviations, (std::vector<std::pair<int, double>>{{1, 3.0}, {0, 2.5}}));
    EXPECT_EQ(read->ssim, 0.2);
    EXPECT_FALSE(limits_from("").has_value());
    EXPECT_FALSE(limits_from("1:a flip 1").has_value());
    const Comparison c = compared(made(2, 0.05), reference);
    EXPECT_TRUE(c.golden);
    EXPECT_EQ(c.scales.front().limit, 3.0);
    EXPECT_EQ(c.flip_mean_limit, 0.5);
    EXPECT_FALSE(c.alike())
        << "of 18,432 normal numbers some are beyond 3, and its variance is that of the difference";
}

// The frame with limits is the reference, whichever is named first.
TEST(Compare, GoldenLimitsHoldFromEitherSide) {
    Picture golden = made(1, 0.05);
    golden.limits = to_text({{{1, 3.0}, {0, 2.5}}, 0.5, 0.9, 0.2});
    const Picture other = made(2, 0.05);
    const Comparison there = compared(other, golden), back = compared(golden, other);
    EXPECT_FALSE(there.swapped);
    EXPECT_TRUE(back.swapped);
    EXPECT_TRUE(back.golden);
    EXPECT_EQ(back.scales.front().limit, 3.0);
    EXPECT_EQ(back.faults, there.faults);
    EXPECT_FALSE(compared(golden, golden).swapped);
    Picture few = other;
    few.samples = 16;
    try {
        compared(golden, few);
        ADD_FAILURE() << "of other samples";
    } catch (const InputError& error) {
        EXPECT_STREQ(error.what(),
                     "b: has 16 samples a pixel, the golden frame a 64: render it with --spp 64");
    }
    golden.limits = "garbage";
    EXPECT_THROW(compared(golden, other), InputError);
}

TEST(Compare, WhatCannotBeComparedIsRefused) {
    const Picture a = made(1, 0.01);
    Picture small = a, alpha = a, odd = a;
    small.height = 32;
    alpha.layers.push_back({"alpha", {"A"}, std::vector<float>(size_t(width * height), 1.0F)});
    odd.layers[1].channels.pop_back();
    for (const Picture* other : {&small, &alpha, &odd}) EXPECT_THROW(compared(*other, a), InputError);
    try {
        compared(small, a);
    } catch (const InputError& error) {
        EXPECT_STREQ(error.what(), "a: is 96 x 32 pixels, b is 96 x 64: compare pictures of one size");
    }
}

TEST(Compare, AlphaIsJudgedAndTheLastPixelsAreSeen) {
    Picture a = without_variance(made(1, 0.0)), b = a;
    a.layers.push_back({"alpha", {"A"}, std::vector<float>(size_t(width * height), 0.0F)});
    b.layers.push_back({"alpha", {"A"}, std::vector<float>(size_t(width * height), 1.0F)});
    EXPECT_FALSE(compared(a, b).alike());
    Picture edge = without_variance(made(1, 0.0, [](int x, int, int) { return x == width - 1 ? 3.0 : 0.0; }));
    EXPECT_LT(compared(edge, without_variance(made(1, 0.0))).ssim, 0.99);
}

// The layer of variance does not have alpha's. As from a shadow catcher: alpha differs, colours do not.
TEST(Compare, NoiseOfAlphaHidesNoPlainDifference) {
    const auto with_alpha = [](uint64_t seed, double noise, double shadow) {
        Picture picture = made(1, 0.0);
        Picture::Layer& alpha = picture.layers.emplace_back("alpha", std::vector<std::string>{"A"});
        for (size_t i = 0; i < size_t(width * height); ++i)
            alpha.pixels.push_back(float(std::clamp(shadow + noise * normal(seed, i), 0.0, 1.0)));
        return picture;
    };
    const Picture clean = with_alpha(1, 0.05, 0.5), noisy = with_alpha(1, 0.9, 0.5);
    EXPECT_TRUE(compared(clean, with_alpha(2, 0.05, 0.5)).alike());
    EXPECT_TRUE(compared(clean, with_alpha(2, 0.05, 0.52)).different());
    EXPECT_TRUE(compared(noisy, noisy).alike());
    const Comparison hidden = compared(noisy, with_alpha(2, 0.9, 0.5));
    EXPECT_FALSE(hidden.alike());
    EXPECT_FALSE(hidden.different()) << why(hidden);
    EXPECT_TRUE(hidden.doubt.starts_with("layer alpha could differ by 0.1: ")) << hidden.doubt;
    EXPECT_TRUE(compared(noisy, with_alpha(2, 0.9, 0.9)).different());
}

TEST(Compare, OneSampleWithVarianceCannotBeTold) {
    Picture a = made(1, 0.3), b = made(2, 0.3);
    a.samples = b.samples = 1;
    const Comparison unknown = compared(a, b);
    EXPECT_FALSE(unknown.has_noise_estimate);
    EXPECT_FALSE(unknown.different()) << why(unknown);
    EXPECT_NE(unknown.doubt.find("one sample a pixel has no variance"), std::string::npos) << unknown.doubt;
    EXPECT_TRUE(compared(a, a).alike());
    EXPECT_TRUE(compared(without_variance(a), without_variance(b)).different())
        << "without a layer the limits of perception hold";
    Picture white = a;
    for (float& v : white.layers[0].pixels) v = v > 0.0F ? 0.0F : 9.0F;
    EXPECT_TRUE(compared(white, b).different()) << "whatever the noise";
}

TEST(Compare, VarianceCannotSwitchJudgingOff) {
    const Picture reference = made(1, 0.05);
    Picture negative = reference, huge = reference, one = reference;
    negative.layers[1].pixels[5] = -1.0F;
    EXPECT_THROW(compared(negative, reference), InputError);
    for (float& v : huge.layers[0].pixels) v = 1.0F - v;
    for (float& v : huge.layers[1].pixels) v = 3e38F;
    EXPECT_LT(compared(huge, reference).scales.front().worst, 1e-9);
    Picture black = huge;
    for (float& v : black.layers[0].pixels) v = 0.0F;
    EXPECT_FALSE(compared(black, reference).alike()) << "it looks quite another";
    one.samples = 1; // one sample gives no variance, whatever its layer says
    for (float& v : one.layers[1].pixels) v = 0.0F;
    EXPECT_TRUE(compared(one, made(2, 0.4)).has_noise_estimate);
    EXPECT_TRUE(compared(one, one).alike());
}

// However dim the picture, a difference of 5 % is found.
TEST(Compare, DimPicturesAreJudgedToo) {
    Picture a = made(1, 0.02), b = made(2, 0.02);
    for (Picture* picture : {&a, &b}) {
        const double scale = picture == &a ? 1e-5 : 1.05e-5;
        for (float& v : picture->layers[0].pixels) v = float(double(v) * scale);
        for (float& v : picture->layers[1].pixels) v = float(double(v) * scale * scale);
    }
    EXPECT_FALSE(compared(b, a).alike());
}

TEST(Compare, LimitsThatMakeNoSenseAreNone) {
    for (const char* text :
         {"garbage", "1:5 flip 1 1", "1:5 flip nan 1 ssim 0", "1:inf flip 1 1 ssim 0", "1:-5 flip 1 1 ssim 0",
          "1:5x flip 1 1 ssim 0", "1:5 flip 1 1 ssim 0 more", "-1:5 flip 1 1 ssim 0"})
        EXPECT_FALSE(limits_from(text).has_value()) << text;
    EXPECT_TRUE(limits_from("1:5 0:4 flip 0.1 0.2 ssim 0.9").has_value());
}

TEST(Compare, LayersComeWhateverTheirOrder) {
    const std::string path =
        (std::filesystem::temp_directory_path() / ("marram_layers_" + std::to_string(::getpid()) + ".exr"))
            .string();
    const std::vector<float> rgba = {1, 2, 3, 0.5F, 4, 5, 6, 1}, depth = {7, 8};
    const Layer layers[] = {{"", {"B", "A", "G", "R"}, rgba.data(), false},
                            {"depth", {"Z"}, depth.data(), false}};
    write_exr(path, 2, 1, layers, {});
    const Picture picture = read_picture(path);
    std::filesystem::remove(path);
    ASSERT_EQ(picture.layers.size(), 3U);
    EXPECT_EQ(picture.find("")->channels, (std::vector<std::string>{"R", "G", "B"}));
    EXPECT_EQ(picture.find("")->pixels, (std::vector<float>{0.5F, 3, 1, 1, 6, 4}));
    EXPECT_EQ(picture.find("alpha")->pixels, (std::vector<float>{2, 5}));
    EXPECT_EQ(picture.find("depth")->pixels, depth);
}

// ---- other layers ---------------------------------------------------------------------------------------------------

namespace {

// A picture with a further layer, filled by `value` for each pixel.
Picture with_layer(const char* name, const std::function<double(int, int)>& value) {
    Picture picture = without_variance(made(1, 0.0));
    Picture::Layer layer{name, {"Y"}, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) layer.pixels.push_back(float(value(x, y)));
    picture.layers.push_back(layer);
    return picture;
}

bool in_square(int x, int y, int side) { return x >= 30 && x < 30 + side && y >= 20 && y < 20 + side; }

} // namespace

// A part of less than 3 %, as much as a layer may differ by in the mean.
TEST(Compare, ASmallPartOfALayerIsMissed) {
    constexpr int side = 13; // 2.75 % of 96 x 64
    const Picture ones = with_layer("envelope", [](int x, int y) { return in_square(x, y, side); }),
                  none = with_layer("envelope", [](int, int) { return 0.0; });
    EXPECT_FALSE(compared(none, ones).alike());
    EXPECT_FALSE(compared(ones, none).alike());
    const Picture whole = with_layer("alpha", [](int, int) { return 1.0; });
    EXPECT_FALSE(
        compared(with_layer("alpha", [](int x, int y) { return !in_square(x, y, side); }), whole).alike());
    EXPECT_FALSE(compared(with_layer("alpha", [](int, int) { return 0.98; }), whole).alike());
    const auto depth = [](double of_it) {
        return with_layer("depth",
                          [=](int x, int y) { return in_square(x, y, 8) ? of_it : 12.0 + 0.05 * x; });
    };
    EXPECT_FALSE(compared(depth(2.0), depth(10.0)).alike()) << "one pixel in a hundred";
    EXPECT_TRUE(compared(depth(2.01), depth(2.0)).alike());
    const Comparison c = compared(depth(2.0), depth(10.0));
    ASSERT_EQ(c.faults.size(), 1U);
    EXPECT_NE(c.faults[0].find("layer depth differs locally: 16 x 16 pixels at (2"), std::string::npos)
        << c.faults[0];
}

// A noisy part of a layer may have other noise; a smooth part may not become noisy.
TEST(Compare, ALayerMayBeNoiseOnlyWhereItIs) {
    const auto half_noise = [](uint64_t seed) {
        return with_layer("strand_u", [=](int x, int y) {
            return double(y) / height + (x < width / 2 ? 0.1 * normal(seed, uint64_t(y * width + x)) : 0.0);
        });
    };
    for (uint64_t seed = 2; seed < 22; ++seed)
        EXPECT_TRUE(compared(half_noise(seed), half_noise(1)).alike()) << seed;
    // Blocks of 3 x 3 pixels, larger than a pixel's neighbourhood: not noise, but a different picture.
    const auto blocks = [](uint64_t seed) {
        return with_layer("strand_u", [=](int x, int y) {
            return x < width / 2 || y > 20 ? 0.5 + 0.2 * normal(1, uint64_t(y * width + x))
                                           : double(hash(seed, uint64_t(y / 3 * width + x / 3)) % 2);
        });
    };
    EXPECT_TRUE(compared(blocks(3), blocks(3)).alike());
    EXPECT_FALSE(compared(blocks(4), blocks(3)).alike());
}

// Here most strands share no pixel. The share of ids that are unknown among their own neighbours bounds how
// many may be unknown in the other picture.
TEST(Compare, FewOtherNamesAreMissed) {
    const auto named = [](double renamed) {
        return with_layer("id", [=](int x, int y) {
            const auto strand = uint64_t(x / 2 + 100 * (y / 4));
            const bool other = double(hash(5, uint64_t(y * width + x)) % 1000) < 1000.0 * renamed;
            return 1.0 + double(hash(other ? 8 + uint64_t(y * width + x) : 7, strand) & 0xfffff);
        });
    };
    EXPECT_TRUE(compared(named(0.0), named(0.0)).alike());
    EXPECT_TRUE(compared(named(0.02), named(0.0)).alike());
    EXPECT_FALSE(compared(named(0.3), named(0.0)).alike());
    EXPECT_FALSE(compared(named(0.85), named(0.0)).alike());
    // With forty strands in each pixel, nearly all ids of one seed are missing in another, but not all.
    const auto dense = [](uint64_t seed, uint64_t names) {
        return with_layer("id", [=](int x, int y) {
            const uint64_t strand = uint64_t(8 * (x + 1000 * y)) + hash(seed, uint64_t(y * width + x)) % 40;
            return 1.0 + double(hash(names, strand) & 0xffffff);
        });
    };
    EXPECT_TRUE(compared(dense(2, 7), dense(1, 7)).alike());
    EXPECT_FALSE(compared(dense(2, 8), dense(1, 7)).alike());
    // A small object with its own id: one pixel in a hundred.
    const auto thing = [](double name) {
        return with_layer("id", [=](int x, int y) { return in_square(x, y, 8) ? name : 5.0; });
    };
    EXPECT_TRUE(compared(thing(7.0), thing(7.0)).alike());
    for (const double other : {0.0, 5.0, 8.0}) {
        const Comparison c = compared(thing(other), thing(7.0));
        ASSERT_EQ(c.faults.size(), 1U) << other;
        EXPECT_NE(c.faults[0].find("layer id has different ids: in 16 x 16 pixels at (2"), std::string::npos)
            << c.faults[0];
    }
}

// Noise at either end of the range: every value has its like nearby, wherever the layer's surfaces are.
TEST(Compare, NoiseHidesNoOtherDepth) {
    // up, down: shares of the far surface in the left and in the right half
    const auto depth = [](uint64_t seed, double up, double down, const char* name = "depth") {
        return with_layer(name, [=](int x, int y) {
            const bool far =
                double(hash(seed, uint64_t(y * width + x)) % 1000) < 1000.0 * (x < width / 2 ? up : down);
            return far ? 10.0 : 2.0;
        });
    };
    for (uint64_t seed = 2; seed < 12; ++seed) {
        const Comparison seeds = compared(depth(seed, 0.6, 0.4), depth(1, 0.6, 0.4));
        EXPECT_TRUE(seeds.alike()) << seed << " " << why(seeds);
    }
    const Comparison c = compared(depth(2, 0.7, 0.3), depth(1, 0.5, 0.5)); // the same mean
    ASSERT_EQ(c.faults.size(), 1U);
    EXPECT_NE(c.faults[0].find("layer depth differs locally: the means of 16 x 16 pixels at ("),
              std::string::npos)
        << c.faults[0];
    EXPECT_GT(c.layers.back().found_from, 0.1 * c.layers.back().range);
    EXPECT_LT(c.layers.back().found_from, 0.3 * c.layers.back().range);
    // Layers that depend on the number of samples are not judged so, and that is said.
    Picture fewer = depth(2, 0.7, 0.3), alpha = depth(2, 0.7, 0.3, "alpha");
    fewer.samples = alpha.samples = 16;
    const Comparison other = compared(fewer, depth(1, 0.5, 0.5));
    EXPECT_TRUE(other.alike()) << why(other);
    ASSERT_EQ(other.notes.size(), 1U);
    EXPECT_NE(other.notes[0].find("layer depth depends on the number of samples a pixel, A has 16, B 64"),
              std::string::npos)
        << other.notes[0];
    EXPECT_TRUE(compared(alpha, depth(1, 0.5, 0.5, "alpha")).different());
}

// Half of the range, over a window, in any noise: different, or it cannot be told.
TEST(Compare, APlainlyDifferentLayerIsNeverAlike) {
    for (const double noise : {0.0, 0.01, 0.1, 0.5, 1.0, 3.0, 30.0}) {
        const auto depth = [&](uint64_t seed, double off) {
            return with_layer("depth", [=](int x, int y) {
                const bool in = x >= 32 && x < 48 && y >= 16 && y < 32;
                return 4.0 + 2.0 * double(x) / width + noise * normal(seed, uint64_t(y * width + x)) +
                       (in ? off : 0.0);
            });
        };
        const Comparison same = compared(depth(2, 0.0), depth(1, 0.0));
        if (noise <= 0.5) {
            EXPECT_TRUE(same.alike()) << noise << " " << why(same);
        }
        const double half = 0.5 * same.layers.back().range;
        for (const double off : {half, -half})
            EXPECT_FALSE(compared(depth(2, off), depth(1, 0.0)).alike()) << noise << " " << off;
    }
    // Sixteen pixels of such noise tell nothing.
    const auto small = [](uint64_t seed) {
        Picture picture{
            4, 4, 64, "", {{"", {"R", "G", "B"}, std::vector<float>(48, 0.5F)}, {"depth", {"Z"}, {}}}};
        for (uint64_t i = 0; i < 16; ++i)
            picture.layers[1].pixels.push_back((hash(seed, i) & 1U) != 0 ? 10.0F : 0.0F);
        return picture;
    };
    EXPECT_TRUE(compared(small(1), small(1)).alike());
    const Comparison c = compared(small(2), small(1));
    EXPECT_FALSE(c.different() || c.alike()) << why(c);
    EXPECT_NE(c.doubt.find("layer depth could differ by half its range: the means of 4 x 4 pixels"),
              std::string::npos)
        << c.doubt;
}

// Every pixel has an id of its own: in another seed all are others, as all ids of another picture would be.
TEST(Compare, IdsThatAreAllNoiseTellNothing) {
    const auto ids = [](uint64_t seed) {
        return with_layer(
            "id", [=](int x, int y) { return double(hash(seed, uint64_t(y * width + x)) & 0xffffff); });
    };
    const Comparison c = compared(ids(2), ids(1));
    EXPECT_FALSE(c.different() || c.alike());
    EXPECT_NE(c.doubt.find("layer id could have other ids everywhere"), std::string::npos) << c.doubt;
    EXPECT_TRUE(compared(ids(1), ids(1)).alike());
}

// ---- FLIP -----------------------------------------------------------------------------------------------------------

namespace {

std::vector<float> plain(float r, float g, float b) {
    std::vector<float> rgb;
    for (int i = 0; i < width * height; ++i) rgb.insert(rgb.end(), {r, g, b});
    return rgb;
}

double mean_flip(const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0.0;
    for (const float f : flip_map(a, b, width, height)) sum += double(f) / (width * height);
    return sum;
}

} // namespace

TEST(Flip, GoesFromNoneToOne) {
    const std::vector<float> green = plain(0, 8, 0), blue = plain(0, 0, 8), grey = plain(0.4F, 0.4F, 0.4F);
    EXPECT_EQ(mean_flip(grey, grey), 0.0);
    EXPECT_GT(mean_flip(green, blue), 0.9);
    EXPECT_LE(mean_flip(green, blue), 1.0);
    double last = 0.0;
    for (const float more : {0.01F, 0.05F, 0.2F, 1.0F}) {
        const double now = mean_flip(plain(0.4F + more, 0.4F + more, 0.4F + more), grey);
        EXPECT_GT(now, last);
        last = now;
    }
    for (const float f : flip_map(green, blue, width, height)) EXPECT_TRUE(f >= 0.0F && f <= 1.0F);
}

// For uniform pictures FLIP is a formula, computed here by hand. Display pictures are compared as shown,
// without an exposure for the darker one.
TEST(Flip, OfDisplayPicturesIsAsTheyAreShown) {
    const auto shown = [](const std::vector<float>& a, const std::vector<float>& b) {
        double sum = 0.0;
        for (const float f : flip_map(a, b, width, height, Range::display))
            sum += double(f) / (width * height);
        return sum;
    };
    EXPECT_NEAR(shown(plain(0, 1, 0), plain(0, 0, 1)), 1.0, 1e-4);
    const auto lightness = [](double y) { return 116.0 * std::cbrt(y) - 16.0; };
    // HyAB of greys is the difference of their lightnesses; that of the weakened green and blue is 203.305.
    const double most = std::pow(203.305, 0.7);
    for (const auto& [dark, light] : {std::pair(0.2, 0.25), {0.02, 0.04}, {0.5, 0.9}}) {
        const double apart = std::pow(lightness(light) - lightness(dark), 0.7);
        const double expected = apart < 0.4 * most ? 0.95 / 0.4 * apart / most
                                                   : 0.95 + (apart - 0.4 * most) / (0.6 * most) * 0.05;
        const auto grey = [](double v) { return plain(float(v), float(v), float(v)); };
        EXPECT_NEAR(shown(grey(dark), grey(light)), expected, 1e-3) << dark;
    }
    EXPECT_EQ(shown(plain(1, 1, 1), plain(7, 7, 7)), 0.0) << "a display shows both as white";
}

// Detail below the eye's resolution counts less: a fine and a coarse checkerboard against their mean grey.
TEST(Flip, FinePatternsCountLessThanCoarseOnes) {
    const auto board = [](int cell) {
        std::vector<float> rgb;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                for (int c = 0; c < 3; ++c) rgb.push_back((x / cell + y / cell) % 2 == 0 ? 0.3F : 0.5F);
        return rgb;
    };
    const std::vector<float> grey = plain(0.4F, 0.4F, 0.4F);
    EXPECT_LT(mean_flip(board(1), grey), 0.5 * mean_flip(board(16), grey));
}

TEST(Flip, SeesAnEdgeThatHasMoved) {
    const auto edge = [](int at) {
        std::vector<float> rgb;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                for (int c = 0; c < 3; ++c) rgb.push_back(x < at ? 0.2F : 0.6F);
        return rgb;
    };
    const std::vector<float> map = flip_map(edge(51), edge(48), width, height);
    const auto at = [&](int x) { return map[size_t(32 * width + x)]; };
    EXPECT_GT(at(49), 0.3F);
    EXPECT_LT(at(10), 0.01F);
}

// A pixel that is very bright in both pictures does not change the result elsewhere.
TEST(Flip, IsNotBlindedByOneBrightPixel) {
    std::vector<float> a = plain(0.2F, 0.2F, 0.2F), b = plain(0.3F, 0.3F, 0.3F);
    const double before = mean_flip(a, b);
    for (int c = 0; c < 3; ++c) a[size_t(c)] = b[size_t(c)] = 1e9F;
    EXPECT_GT(mean_flip(a, b), 0.9 * before);
    // A small object on black: the median is 0, and the exposure is chosen for the object.
    const auto dim = [](float of_it, float bright) {
        std::vector<float> rgb = plain(0, 0, 0);
        for (int i = 0; i < 300; ++i) rgb[size_t(3 * (20 * width) + i)] = of_it;
        rgb[0] = bright;
        return rgb;
    };
    EXPECT_GT(mean_flip(dim(0.2F, 1e9F), dim(0.6F, 1e9F)), 0.9 * mean_flip(dim(0.2F, 0.6F), dim(0.6F, 0.6F)));
}

// Black, very bright and negative pictures give numbers.
TEST(Flip, SurvivesAnyRange) {
    const std::vector<float> black = plain(0, 0, 0), bright = plain(6e4F, 6e4F, 6e4F),
                             odd = plain(-1, 0, 1e-30F);
    for (const auto& a : {black, bright, odd})
        for (const auto& b : {black, bright, odd})
            for (const float f : flip_map(a, b, width, height)) ASSERT_TRUE(f >= 0.0F && f <= 1.0F);
}

} // namespace marram
