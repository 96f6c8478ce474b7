// SPDX-License-Identifier: Apache-2.0
// Contact sheets: positions and colours of pictures, captions, and sheets without a font.
#include "core/image/sheet.h"

#include "core/image/image.h"
#include "core/math/problem.h"
#include "tests/unit/files.h"

#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>

namespace marram {
namespace {

namespace fs = std::filesystem;

class Sheet : public ::testing::Test {
  protected:
    Sheet() {
        std::string pattern = (fs::temp_directory_path() / "marram_sheet_XXXXXX").string();
        folder_ = ::mkdtemp(pattern.data());
    }
    ~Sheet() override { fs::remove_all(folder_); }

    std::string path(const std::string& name) const { return (folder_ / name).string(); }

    // Writes a picture of one colour.
    std::string write(const std::string& name, int width, int height, std::array<float, 3> colour,
                      const std::vector<Metadata>& metadata = {}) const {
        std::vector<float> pixels;
        for (int i = 0; i < width * height; ++i) pixels.insert(pixels.end(), colour.begin(), colour.end());
        if (name.ends_with(".exr")) {
            const Layer layer{"", {"R", "G", "B"}, pixels.data()};
            write_exr(path(name), width, height, std::span(&layer, 1), metadata);
        } else {
            write_png(path(name), width, height, 3, pixels.data(), 0.0, metadata);
        }
        return path(name);
    }

    // Linear colour of a sheet's pixel.
    static std::array<float, 3> at(const Image& sheet, int x, int y) {
        const float* p = sheet.pixels.data() + 3 * (size_t(y) * size_t(sheet.width) + size_t(x));
        return {p[0], p[1], p[2]};
    }

    static void expect_colour(const Image& sheet, int x, int y, std::array<float, 3> expected) {
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(at(sheet, x, y)[c], expected[c], 0.01) << x << ", " << y;
    }

    // The number of pixels in a box that are brighter than the background.
    static int ink_in(const Image& sheet, int x0, int x1, int y0, int y1) {
        int count = 0;
        for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x) count += at(sheet, x, y)[0] > 0.1F;
        return count;
    }

    fs::path folder_;
};

// Columns of 192 pixels with 8 between: (2 x 192 + 3 x 8) = 408.
TEST_F(Sheet, PutsPicturesInRowsAndColumns) {
    const std::vector<SheetPicture> pictures = {{write("a.png", 40, 20, {1, 0, 0}), ""},
                                                {write("b.exr", 40, 20, {0, 1, 0}), ""},
                                                {write("c.png", 400, 200, {0, 0, 1}), ""}};
    EXPECT_TRUE(write_sheet(path("s.png"), pictures, {.columns = 2, .width = 408}));
    const Image sheet = read_image(path("s.png"));
    EXPECT_EQ(sheet.width, 408);
    EXPECT_EQ(sheet.height, 8 + 96 + 8 + 96 + 8);
    expect_colour(sheet, 4, 4, {0.02F, 0.02F, 0.02F});
    for (const int x : {10, 100, 197}) expect_colour(sheet, x, 50, {1, 0, 0});
    for (const int x : {210, 300, 397}) expect_colour(sheet, x, 50, {0, 1, 0});
    for (const int y : {114, 160, 205}) expect_colour(sheet, 100, y, {0, 0, 1});
    expect_colour(sheet, 203, 50, {0.02F, 0.02F, 0.02F});
    expect_colour(sheet, 300, 160, {0.02F, 0.02F, 0.02F});
}

TEST_F(Sheet, FitsPicturesOfAllShapes) {
    const std::vector<SheetPicture> pictures = {{write("tall.png", 10, 1000, {1, 0, 0}), ""},
                                                {write("wide.png", 1000, 1, {0, 1, 0}), ""}};
    write_sheet(path("s.png"), pictures, {.columns = 2, .width = 408});
    const Image sheet = read_image(path("s.png"));
    EXPECT_EQ(sheet.height, 8 + 384 + 8);
    expect_colour(sheet, 8 + 96, 8 + 192, {1, 0, 0});
    expect_colour(sheet, 8 + 90, 8 + 192, {0.02F, 0.02F, 0.02F});
    expect_colour(sheet, 208 + 96, 8 + 383, {0, 1, 0});
}

TEST_F(Sheet, ShowsLinearLightAsItIsExposed) {
    const std::string exr = write("a.exr", 8, 8, {0.1F, 0.2F, 40}),
                      png = write("b.png", 8, 8, {0.1F, 0.2F, 0.3F});
    write_sheet(path("s.png"), {{exr, ""}, {png, ""}}, {.columns = 2, .width = 408, .exposure = 1.0});
    const Image sheet = read_image(path("s.png"));
    expect_colour(sheet, 100, 100, {0.2F, 0.4F, 1});
    expect_colour(sheet, 300, 100, {0.1F, 0.2F, 0.3F});
}

TEST_F(Sheet, WritesCaptions) {
    const std::string a = write("a.png", 40, 20, {0, 0, 0}), b = write("b.png", 40, 20, {0, 0, 0});
    const SheetLayout layout{.columns = 2, .width = 408};
    ASSERT_TRUE(write_sheet(path("s.png"), {{a, "12"}, {b, ""}}, layout)) << "fonts-dejavu-core is installed";
    const Image sheet = read_image(path("s.png"));
    ASSERT_GT(sheet.height, 8 + 96 + 8 + 10);
    EXPECT_GT(ink_in(sheet, 8, 200, 104, sheet.height), 15);
    EXPECT_EQ(ink_in(sheet, 208, 400, 104, sheet.height), 0);
    // Too long: cut to its column.
    write_sheet(path("t.png"), {{a, std::string(500, 'm')}, {b, "\xc3\xa9 \xff \x01"}}, layout);
    const Image cut = read_image(path("t.png"));
    EXPECT_GT(ink_in(cut, 8, 200, 104, cut.height), 200);
    EXPECT_EQ(ink_in(cut, 200, 208, 0, cut.height), 0);
    EXPECT_EQ(ink_in(cut, 0, 8, 0, cut.height), 0);
    EXPECT_GT(ink_in(cut, 208, 400, 104, cut.height), 15);
    // The same bytes on a second run.
    write_sheet(path("u.png"), {{a, "12"}, {b, ""}}, layout);
    EXPECT_TRUE(marram::read_file(path("s.png")) == marram::read_file(path("u.png")));
}

TEST_F(Sheet, HasNoCaptionsWithoutAFontAndSaysSo) {
    const std::string a = write("a.png", 40, 20, {0, 0, 0});
    SheetLayout layout{.width = 208};
    layout.fonts = {"no_such_font"};
    EXPECT_FALSE(write_sheet(path("s.png"), {{a, "12"}}, layout));
    EXPECT_EQ(read_image(path("s.png")).height, 8 + 96 + 8);
    EXPECT_TRUE(write_sheet(path("s.png"), {{a, ""}}, layout)) << "none was wanted";
    layout.font = "no_such_font_either";
    EXPECT_THROW(write_sheet(path("s.png"), {{a, "12"}}, layout), InputError);
}

TEST_F(Sheet, RefusesWhatLeavesNoRoom) {
    const std::string a = write("a.png", 40, 20, {0, 0, 0}), tall = write("tall.png", 1, 100, {0, 0, 0});
    EXPECT_THROW(
        write_sheet(path("s.png"), std::vector<SheetPicture>(20, {a, ""}), {.columns = 20, .width = 100}),
        InputError);
    EXPECT_THROW(
        write_sheet(path("s.png"), std::vector<SheetPicture>(40, {tall, ""}), {.columns = 1, .width = 2000}),
        InputError);
    EXPECT_THROW(write_sheet(path("s.png"), {{path("none.png"), ""}}, {}), InputError);
    EXPECT_FALSE(fs::exists(path("s.png")));
    const float depth[4] = {1, 2, 3, 4};
    const Layer layers[] = {{"depth", {"Z"}, depth}, {"other", {"Z"}, depth}};
    write_exr(path("depth.exr"), 2, 2, layers, {});
    EXPECT_THROW(write_sheet(path("s.png"), {{path("depth.exr"), ""}}, {}), InputError);
}

TEST_F(Sheet, CaptionsTellPicturesApart) {
    using Texts = std::vector<std::string>;
    const auto frame = [](const char* scene, double number) {
        return std::vector<Metadata>{{"marram:scene", std::string(scene)}, {"marram:frame", number}};
    };
    const std::string a = write("f.0001.png", 4, 4, {}, frame("a.toml", 1)),
                      b = write("f.0002.exr", 4, 4, {}, frame("a.toml", 2.5)),
                      other = write("g.0003.png", 4, 4, {}, frame("b.toml", 3)),
                      plain = write("h12_x.png", 4, 4, {}), bare = write("last.png", 4, 4, {});
    EXPECT_EQ(sheet_captions({a, b}), (Texts{"1", "2.5"}));
    EXPECT_EQ(sheet_captions({a, other}), (Texts{"f.0001", "g.0003"}));
    EXPECT_EQ(sheet_captions({a, plain}), (Texts{"f.0001", "h12_x"}));
    EXPECT_EQ(sheet_captions({a}), Texts{"f.0001"});
    EXPECT_EQ(sheet_captions({a, a}), (Texts{a, a}));
    EXPECT_EQ(frame_captions({a, plain, bare}), (Texts{"1", "12", "last"}));
    EXPECT_EQ(name_captions({"x/a.png", "y/b.png"}), (Texts{"a", "b"}));
    EXPECT_EQ(name_captions({"x/a.png", "y/a.exr"}), (Texts{"a.png", "a.exr"}));
    EXPECT_EQ(name_captions({"x/a.png", "y/a.png"}), (Texts{"x/a.png", "y/a.png"}));
}

} // namespace
} // namespace marram
