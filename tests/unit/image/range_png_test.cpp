// SPDX-License-Identifier: Apache-2.0
// Layers as PNGs: the mapping from values to codes, for each number of channels.
#include "core/image/range_png.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include <unistd.h>

namespace marram {
namespace {

TEST(RangePng, BlackAndWhiteAreTheEndsOfTheRange) {
    EXPECT_EQ(code_of(0.0, {0.0, 20.0}), 0);
    EXPECT_EQ(code_of(20.0, {0.0, 20.0}), 65535);
    EXPECT_EQ(code_of(5.0, {0.0, 20.0}), 16384);
    EXPECT_EQ(code_of(-1.0, {0.0, 20.0}), 0);
    EXPECT_EQ(code_of(1e30, {0.0, 20.0}), 65535);
    EXPECT_EQ(code_of(0.0, {-1.0, 1.0}), 32768);
    EXPECT_EQ(code_of(5.0, {20.0, 0.0}), 49151);
    EXPECT_EQ(code_of(std::numeric_limits<double>::infinity(), {0.0, 20.0}), 65535);
    EXPECT_EQ(code_of(std::numeric_limits<double>::infinity(), {20.0, 0.0}), 0);
    EXPECT_EQ(code_of(std::nan(""), {0.0, 20.0}), 0);
}

TEST(RangePng, KeepsValuesToSixteenBits) {
    const std::string path =
        (std::filesystem::temp_directory_path() / ("marram_range_" + std::to_string(::getpid()) + ".png"))
            .string();
    for (int channels = 1; channels <= 4; ++channels) {
        std::vector<float> pixels;
        for (int i = 0; i < 3 * 2 * channels; ++i) pixels.push_back(float(i) * 0.37F - 2.0F);
        const ValueRange range{-2.0, 8.0};
        write_range_png(path, 3, 2, channels, pixels.data(), range,
                        std::vector<Metadata>{{"marram:layer", std::string("a -2 8")}});
        const Image image = read_image(path, ColorSpace::linear_data);
        EXPECT_EQ(image.width, 3);
        EXPECT_EQ(image.height, 2);
        ASSERT_EQ(image.channels, channels == 2 ? 3 : channels);
        for (size_t i = 0; i < 6; ++i)
            for (size_t c = 0; c < size_t(image.channels); ++c) {
                const float value = image.pixels[i * size_t(image.channels) + c];
                if (channels == 2 && c == 2)
                    EXPECT_EQ(value, 0.0F) << "blue is not used";
                else
                    EXPECT_NEAR(-2.0 + 10.0 * double(value), double(pixels[i * size_t(channels) + c]),
                                10.0 / 65535.0);
            }
        EXPECT_EQ(read_metadata(path, "marram:layer"), "a -2 8");
    }
    std::filesystem::remove(path);
}

} // namespace
} // namespace marram
