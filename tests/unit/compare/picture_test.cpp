// SPDX-License-Identifier: Apache-2.0
// How `marram compare` reads files of all formats.
#include "core/image/picture.h"

#include "core/compare/compare.h"
#include "core/math/problem.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct PictureFiles : testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_picture_test_" + std::to_string(::getpid()));
    PictureFiles() { fs::create_directories(folder); }
    ~PictureFiles() override { fs::remove_all(folder); }
    std::string path(const char* name) const { return (folder / name).string(); }

    // A row of pixels with these channel names: 0.125, 0.25, ...
    Picture picture_of(const std::vector<std::string>& channels) const {
        std::vector<float> pixels(2 * channels.size());
        for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = 0.125F * float(i + 1);
        const Layer layer{"", channels, pixels.data(), false};
        write_exr(path("named.exr"), 2, 1, std::span(&layer, 1), {});
        return read_picture(path("named.exr"));
    }
};

// PNG stores straight alpha, EXR premultiplied.
TEST_F(PictureFiles, ColourIsMultipliedByAlphaWhateverTheFormat) {
    constexpr int side = 16;
    std::vector<float> rgba;
    for (int i = 0; i < side * side; ++i) {
        const float alpha = i % side < 4 ? 1.0F : i % side < 12 ? 0.5F : 0.0F;
        rgba.insert(rgba.end(), {0.8F * alpha, 0.4F * alpha, 0.2F * alpha, alpha});
    }
    const Layer layer{"", {"R", "G", "B", "A"}, rgba.data(), true};
    write_exr(path("a.exr"), side, side, std::span(&layer, 1), {});
    write_png(path("a.png"), side, side, 4, rgba.data(), 0.0);
    EXPECT_TRUE(read_image(path("a.png")).straight_alpha);
    EXPECT_FALSE(read_image(path("a.exr")).straight_alpha);
    const Picture png = read_picture(path("a.png")), exr = read_picture(path("a.exr"));
    ASSERT_EQ(png.layers.size(), exr.layers.size());
    for (size_t i = 0; i < exr.layers[0].pixels.size(); ++i)
        EXPECT_NEAR(png.find("")->pixels[i], exr.find("")->pixels[i], 0.005F) << i;
    EXPECT_TRUE(compare_pictures(png, exr, "png", "exr").alike());
    // TIFF can hold either, and says which.
    OIIO::ImageSpec spec(1, 1, 4, OIIO::TypeDesc::FLOAT);
    const float straight[4] = {0.8F, 0.4F, 0.2F, 0.5F};
    for (const bool apart : {true, false}) {
        spec.attribute("oiio:UnassociatedAlpha", int(apart));
        const auto output = OIIO::ImageOutput::create("a.tif");
        ASSERT_TRUE(output->open(path("a.tif"), spec) &&
                    output->write_image(OIIO::TypeDesc::FLOAT, straight) && output->close());
        EXPECT_EQ(read_picture(path("a.tif")).find("")->pixels[0], apart ? 0.4F : 0.8F);
    }
    EXPECT_EQ(png.read_as, "sRGB");
    EXPECT_EQ(exr.read_as, "linear");
}

// A sky behind strands adds light with an alpha of 0.
TEST_F(PictureFiles, ColourUnderNoAlphaIsKept) {
    const float white[] = {1.0F, 1.0F, 1.0F, 0.0F, 0.001F, 0.001F, 0.001F, 0.0015F},
                black[] = {0.0F, 0.0F, 0.0F, 0.0F, 0.0F, 0.0F, 0.0F, 0.0F};
    write_png(path("white.png"), 2, 1, 4, white, 0.0);
    write_png(path("black.png"), 2, 1, 4, black, 0.0);
    const Picture a = read_picture(path("white.png")), b = read_picture(path("black.png"));
    EXPECT_NEAR(a.find("")->pixels[0], 1.0F, 1e-5F);
    EXPECT_NEAR(a.find("")->pixels[3], 0.001F, 1e-3F) << "its alpha is stored as 0";
    EXPECT_FALSE(compare_pictures(a, b, "a", "b").equal);
    EXPECT_TRUE(compare_pictures(a, b, "a", "b").different());
}

TEST_F(PictureFiles, ColoursMayBeCalledOtherwise) {
    const std::vector<float> expected = picture_of({"R", "G", "B", "A"}).find("")->pixels;
    ASSERT_EQ(expected.size(), 6U);
    for (const auto& names : {std::vector<std::string>{"r", "g", "b", "a"},
                              {"Beauty.R", "Beauty.G", "Beauty.B", "Beauty.A"},
                              {"c.r", "c.g", "c.b", "c.a"}}) {
        const Picture picture = picture_of(names);
        ASSERT_TRUE(picture.find("")) << names[0];
        EXPECT_EQ(picture.find("")->pixels, expected) << names[0];
        EXPECT_EQ(picture.find("")->channels, (std::vector<std::string>{"R", "G", "B"})) << names[0];
        EXPECT_TRUE(picture.find("alpha")) << names[0];
        EXPECT_FALSE(picture.grey);
    }
    // With several prefixes the picture is ambiguous. Channels of our own layers are never the picture.
    EXPECT_FALSE(picture_of({"a.R", "a.G", "a.B", "b.R", "b.G", "b.B"}).find(""));
    EXPECT_FALSE(picture_of({"variance.R", "variance.G", "variance.B"}).find(""));
    EXPECT_TRUE(picture_of({"R", "G", "B", "albedo.R", "albedo.G", "albedo.B"}).find("albedo"));
}

TEST_F(PictureFiles, OneChannelOfAnyNameIsGrey) {
    for (const char* name : {"Y", "Z", "mask", "depth.Z", "A"}) {
        const Picture picture = picture_of({name});
        EXPECT_TRUE(picture.grey) << name;
        ASSERT_TRUE(picture.find("")) << name;
        EXPECT_EQ(picture.find("")->pixels,
                  (std::vector<float>{0.125F, 0.125F, 0.125F, 0.25F, 0.25F, 0.25F}));
        EXPECT_TRUE(compare_pictures(picture, picture, "a", "b").equal);
    }
}

// Checks the header: a file that would take more than 8 GiB is not read.
TEST_F(PictureFiles, WhatWouldNotFitIsRefusedFirst) {
    std::ofstream(path("huge.pgm")) << "P5\n8000 6000\n255\n";
    fs::resize_file(path("huge.pgm"), 8000ULL * 6000ULL + 17);
    try {
        read_picture(path("huge.pgm"));
        ADD_FAILURE() << "it was read";
    } catch (const InputError& error) {
        EXPECT_NE(
            std::string(error.what()).find("is 8000 x 6000 pixels of 1 channels: comparing it would take"),
            std::string::npos)
            << error.what();
    }
}

} // namespace
} // namespace marram
