// SPDX-License-Identifier: Apache-2.0
// Holes that files declare, and values that stand alone.
#include "core/image/data_image.h"

#include "core/math/problem.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr int side = 16;

struct Bytes {
    bool big_endian = false;
    std::string text{};
    void add(uint64_t value, int bytes) {
        for (int i = 0; i < bytes; ++i) text += char(value >> (8 * (big_endian ? bytes - 1 - i : i)));
    }
    void entry(uint64_t tag, uint64_t type, uint64_t count, uint64_t value) {
        add(tag, 2), add(type, 2), add(count, 4);
        if (type == 3)
            add(value, 2), add(0, 2);
        else
            add(value, 4);
    }
};

// A TIFF of side x side numbers of one channel, as GDAL writes them. bits: 32 floats; 16 signed integers.
std::string tiff(const std::vector<double>& values, const std::string& nodata, int bits = 32,
                 bool big_endian = false) {
    Bytes file{big_endian, big_endian ? "MM" : "II"};
    file.add(42, 2), file.add(8, 4);
    constexpr uint64_t entries = 11, text_at = 8 + 2 + 12 * entries + 4;
    const uint64_t length = nodata.size() + 1, pixels_at = text_at + length + length % 2;
    file.add(entries, 2);
    file.entry(256, 3, 1, side), file.entry(257, 3, 1, side), file.entry(258, 3, 1, uint64_t(bits));
    file.entry(259, 3, 1, 1), file.entry(262, 3, 1, 1), file.entry(273, 4, 1, pixels_at),
        file.entry(277, 3, 1, 1);
    file.entry(278, 3, 1, side), file.entry(279, 4, 1, uint64_t(side * side * bits / 8));
    file.entry(339, 3, 1, bits == 32 ? 3 : 2);
    file.entry(42113, 2, length, text_at);
    if (length <= 4) file.text.replace(file.text.size() - 4, length, nodata + '\0'); // in place of its offset
    file.add(0, 4);
    file.text += nodata;
    file.text.resize(pixels_at, '\0');
    for (const double value : values)
        if (bits == 32) {
            const auto single = float(value);
            uint32_t word = 0;
            std::memcpy(&word, &single, 4);
            file.add(word, 4);
        } else {
            file.add(uint64_t(int64_t(value)), 2);
        }
    return file.text;
}

struct DataImages : testing::Test {
    fs::path path = fs::temp_directory_path() / ("marram_data_image_" + std::to_string(::getpid()) + ".tif");
    ~DataImages() override { fs::remove(path); }
    std::vector<std::string> notes;
    Image read(const std::string& bytes) {
        std::ofstream(path, std::ios::binary) << bytes;
        notes.clear();
        return read_data_image(path.string(), notes);
    }
};

// A slope of 20 + 2 x - y, with a hole of 4 x 4 in the middle and one of a pixel in the corner.
bool in_hole(int x, int y) { return (x >= 6 && x < 10 && y >= 5 && y < 9) || (x == 15 && y == 15); }
double slope(int x, int y) { return 20.0 + 2.0 * x - y; }
std::vector<double> with_holes(double hole) {
    std::vector<double> values;
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) values.push_back(in_hole(x, y) ? hole : slope(x, y));
    return values;
}

TEST_F(DataImages, DeclaredHolesAreFilledFromAround) {
    const double lowest = double(std::numeric_limits<float>::lowest()), nan = std::nan(""),
                 infinity = std::numeric_limits<double>::infinity();
    struct Case {
        double hole;
        const char* declared;
        int bits;
        bool big_endian;
    };
    for (const Case& c : {Case{-9999.0, "-9999", 32, false},
                          {-9999.0, "-9999.0 ", 32, true},
                          {nan, "nan", 32, false},
                          {lowest, "-3.40282346638529e+38", 32, false},
                          {lowest, "-3.40282e+38", 32, false},
                          {lowest, "-1.7976931348623157e+308", 32, false},
                          {-infinity, "-1.7976931348623157e+308", 32, false}, // doubles, read as floats
                          {-infinity, "-1.79769313486232e+308", 32, false}, // beyond a double, as GDAL rounds
                          {-infinity, "-inf", 32, false},
                          {infinity, "+inf", 32, true},
                          {-9999.0, "-9999", 16, false},
                          {-32768.0, "-32768", 16, true}}) {
        const Image image = read(tiff(with_holes(c.hole), c.declared, c.bits, c.big_endian));
        ASSERT_EQ(notes.size(), 1U) << c.declared;
        EXPECT_EQ(notes[0].find("17 of 256 pixels, the first at (6, 5), are holes (the file declares "), 0U)
            << notes[0];
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x) {
                const double value = double(image.pixels[size_t(y * side + x)]) * image.stored_one;
                EXPECT_NEAR(value, slope(x, y), in_hole(x, y) ? 1.7 : 0.01)
                    << c.declared << " " << x << " " << y;
            }
    }
}

TEST_F(DataImages, NothingIsFilledWithoutHoles) {
    read(tiff(with_holes(30.0), "-9999"));
    EXPECT_TRUE(notes.empty());
    EXPECT_EQ(declared_nodata(path.string()), -9999.0);
    for (const char* beyond : {"-1.7976931348623157e+308", "-1.79769313486232e+308", "inf"}) {
        read(tiff(with_holes(30.0), beyond));
        EXPECT_TRUE(notes.empty()) << beyond;
    }
    read(tiff(with_holes(30.0), "none"));
    EXPECT_FALSE(declared_nodata(path.string()).has_value());
    EXPECT_FALSE(declared_nodata("there is no such file").has_value());
    EXPECT_THROW(read(tiff(std::vector<double>(side * side, -9999.0), "-9999")), InputError);
    EXPECT_THROW(read(tiff(with_holes(std::nan("")), "-9999")), InputError) << "not declared";
    // A damaged file: its entries do not end.
    std::ofstream(path, std::ios::binary) << tiff(with_holes(0.0), "-9999").substr(0, 30);
    EXPECT_FALSE(declared_nodata(path.string()).has_value());
}

TEST_F(DataImages, ValuesThatStandAloneAreReported) {
    for (const double alone : {-9999.0, -32768.0, double(std::numeric_limits<float>::lowest()), 1e20}) {
        const Image image = read(tiff(with_holes(alone), ""));
        ASSERT_EQ(notes.size(), 1U) << alone;
        EXPECT_EQ(notes[0].find("17 of 256 pixels, the first at (6, 5), are "), 0U) << notes[0];
        EXPECT_NE(notes[0].find(", far from all others, which are 5 to 50: "), std::string::npos) << notes[0];
        EXPECT_LT(notes[0].size(), 220U);
        EXPECT_EQ(image.pixels[size_t(5 * side + 6)], float(alone)) << "it is kept";
    }
    for (const double near : {-90.0, 1.0, 120.0}) {
        read(tiff(with_holes(near), ""));
        EXPECT_TRUE(notes.empty()) << near;
    }
    std::vector<double> mask(side * side, 0.0);
    mask[3] = 1.0;
    read(tiff(mask, ""));
    EXPECT_TRUE(notes.empty()) << "a mask";
}

} // namespace
} // namespace marram
