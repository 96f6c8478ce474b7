// SPDX-License-Identifier: Apache-2.0
#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/math/problem.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

namespace marram {
namespace {

namespace fs = std::filesystem;

// This test's own folder, removed with it.
struct ImageFiles : testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_image_test_" + std::to_string(::getpid()));
    ImageFiles() { fs::create_directories(folder); }
    ~ImageFiles() override { fs::remove_all(folder); }

    std::string path(const char* name) const { return (folder / name).string(); }
    void put(const char* name, const std::string& bytes) const {
        std::ofstream(folder / name, std::ios::binary) << bytes;
    }
    std::string get(const char* name) const {
        std::ostringstream text;
        text << std::ifstream(folder / name, std::ios::binary).rdbuf();
        return text.str();
    }
    size_t count() const {
        return size_t(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
    }
};

std::string message_of(const std::string& path) {
    try {
        read_image(path);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

TEST(Srgb, IsTheStandardCurve) {
    EXPECT_FLOAT_EQ(srgb_from_linear(0.0f), 0.0f);
    EXPECT_FLOAT_EQ(srgb_from_linear(1.0f), 1.0f);
    EXPECT_NEAR(srgb_from_linear(0.5f), 0.735357f, 1e-6f);
    for (float v = -1.0f; v <= 2.0f; v += 0.01f) EXPECT_NEAR(linear_from_srgb(srgb_from_linear(v)), v, 2e-6f);
}

TEST_F(ImageFiles, ExrKeepsLayersAndMetadata) {
    constexpr int width = 37, height = 300; // more than one strip, not a multiple of a block
    std::vector<float> beauty(width * height * 4), depth(width * height), albedo(width * height * 3);
    std::mt19937 random(3);
    std::uniform_real_distribution<float> uniform(0.0f, 10.0f);
    for (float& v : beauty) v = uniform(random);
    for (float& v : depth) v = uniform(random) * 1234.567f;
    for (float& v : albedo) v = uniform(random) / 10.0f;
    beauty[0] = 1e9f; // exceeds half
    const Layer layers[] = {{"", {"R", "G", "B", "A"}, beauty.data(), true},
                            {"depth", {"Z"}, depth.data(), false},
                            {"albedo", {"R", "G", "B"}, albedo.data(), true}};
    const Metadata metadata[] = {
        {"marram:scene", "dune.toml"}, {"marram:samples", 64}, {"marram:frame", 0.1}};
    write_exr(path("a.exr"), width, height, layers, metadata);
    write_exr(path("b.exr"), width, height, layers, metadata);
    EXPECT_EQ(get("a.exr"), get("b.exr"));
    EXPECT_EQ(count(), 2u); // no partial file is left

    const Image image = read_image(path("a.exr"));
    EXPECT_EQ(image.channel_names,
              (std::vector<std::string>{"R", "G", "B", "A", "albedo.R", "albedo.G", "albedo.B", "depth.Z"}));
    ASSERT_EQ(image.pixels.size(), size_t(width * height * 8));
    EXPECT_EQ(image.pixels[0], 65504.0f);
    for (size_t i = 0; i < size_t(width * height); ++i) {
        for (size_t c = i == 0 ? 1 : 0; c < 4; ++c)
            ASSERT_NEAR(image.pixels[i * 8 + c], beauty[i * 4 + c], beauty[i * 4 + c] / 2000.0f);
        for (size_t c = 0; c < 3; ++c)
            ASSERT_NEAR(image.pixels[i * 8 + 4 + c], albedo[i * 3 + c], albedo[i * 3 + c] / 2000.0f + 1e-7f);
        ASSERT_EQ(image.pixels[i * 8 + 7], depth[i]);
    }
    EXPECT_EQ(read_metadata(path("a.exr"), "marram:scene"), "dune.toml");
    EXPECT_EQ(read_metadata(path("a.exr"), "marram:samples"), "64");
    EXPECT_EQ(read_metadata(path("a.exr"), "marram:frame"), "0.1");
    EXPECT_EQ(read_metadata(path("a.exr"), "marram:nothing"), std::nullopt);
}

TEST_F(ImageFiles, MetadataOfPartialFilesIsNotTrusted) {
    std::vector<float> pixels(64 * 64 * 3, 0.25f);
    std::mt19937 random(5);
    for (float& v : pixels) v = float(random() % 1000);
    const Layer layers[] = {{"", {"R", "G", "B"}, pixels.data(), true}};
    const Metadata metadata[] = {{"marram:scene", "x"}};
    write_exr(path("a.exr"), 64, 64, layers, metadata);
    EXPECT_EQ(read_metadata(path("a.exr"), "marram:scene"), "x");
    put("cut.exr", get("a.exr").substr(0, get("a.exr").size() - 20));
    EXPECT_EQ(whole_metadata(path("cut.exr"), "marram:scene"), std::nullopt);
    put("text.exr", "nothing");
    EXPECT_EQ(read_metadata(path("text.exr"), "marram:scene"), std::nullopt);
    EXPECT_EQ(read_metadata(path("none.exr"), "marram:scene"), std::nullopt);
    EXPECT_EQ(read_metadata(folder.string(), "marram:scene"), std::nullopt);
}

namespace {

// Writes 8-bit values to a file that states this colour space ("": none).
void write_bytes(const std::string& path, const std::vector<uint8_t>& bytes, const std::string& space,
                 float gamma = 0.0f) {
    OIIO::ImageSpec spec(int(bytes.size() / 3), 1, 3, OIIO::TypeDesc::UINT8);
    if (!space.empty()) spec.attribute("oiio:ColorSpace", space);
    if (gamma > 0.0f) spec.attribute("oiio:Gamma", gamma);
    const auto output = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(output && output->open(path, spec) &&
                output->write_image(OIIO::TypeDesc::UINT8, bytes.data()) && output->close());
}

} // namespace

// The linear values are the same for every way in which a file states its encoding.
TEST_F(ImageFiles, ColoursAreMadeLinearFromWhatTheFileSays) {
    const std::vector<uint8_t> bytes = {0, 0, 0, 64, 64, 64, 128, 128, 128, 255, 255, 255};
    const auto expect = [&](const char* name, auto&& light) {
        const Image image = read_image(path(name)), data = read_image(path(name), ColorSpace::linear_data);
        for (size_t i = 0; i < bytes.size(); ++i) {
            EXPECT_NEAR(image.pixels[i], light(float(bytes[i]) / 255.0f), 1e-6f) << name << ' ' << i;
            EXPECT_NEAR(data.pixels[i], float(bytes[i]) / 255.0f, 1e-6f) << name << ' ' << i;
        }
        EXPECT_TRUE(data.as_in_file);
        return image.as_in_file;
    };
    const auto power = [](float exponent) { return [exponent](float v) { return std::pow(v, exponent); }; };
    write_bytes(path("plain.png"), bytes, "sRGB");
    EXPECT_FALSE(expect("plain.png", linear_from_srgb));
    write_bytes(path("said_nothing.tif"), bytes, "");
    EXPECT_FALSE(expect("said_nothing.tif", linear_from_srgb));
    put("a.ppm", "P6\n4 1\n255\n" + std::string(bytes.begin(), bytes.end())); // OpenImageIO calls it Rec709
    EXPECT_FALSE(expect("a.ppm", linear_from_srgb));
    // PFM is also called Rec709, but holds linear light.
    const float light[12] = {3.0f, 3.0f, 3.0f, 0.5f, 0.5f, 0.5f, 0.25f, 0.25f, 0.25f, 7.0f, 7.0f, 7.0f};
    put("a.pfm", "PF\n4 1\n-1.0\n" + std::string(reinterpret_cast<const char*>(light), sizeof light));
    const Image floats = read_image(path("a.pfm"));
    EXPECT_TRUE(std::equal(floats.pixels.begin(), floats.pixels.end(), light));
    EXPECT_TRUE(floats.as_in_file);
    // A PNG that states only 1 / 2.2 means sRGB, as in libpng; other files mean what they state.
    for (const float gamma : {2.2f, 2.19f}) {
        write_bytes(path("gamma22.png"), bytes, "Gamma2.2", gamma);
        EXPECT_FALSE(expect("gamma22.png", linear_from_srgb));
        EXPECT_EQ(read_image(path("gamma22.png")).read_as, "sRGB");
    }
    write_bytes(path("gamma18.png"), bytes, "Gamma1.8", 1.8f);
    EXPECT_FALSE(expect("gamma18.png", power(1.8f)));
    EXPECT_EQ(read_image(path("gamma18.png")).read_as, "gamma 1.8");
    write_bytes(path("gamma22.tga"), bytes, "Gamma2.2", 2.2f);
    EXPECT_FALSE(expect("gamma22.tga", power(2.2f)));
    write_bytes(path("linear.png"), bytes, "linear", 1.0f);
    EXPECT_TRUE(expect("linear.png", power(1.0f)));
    EXPECT_EQ(read_image(path("linear.png")).read_as, "linear");
    write_bytes(path("film.dpx"), bytes, "KodakLog");
    EXPECT_NE(
        message_of(path("film.dpx")).find("is in the colour space \"KodakLog\", which is not known here"),
        std::string::npos);
    EXPECT_NO_THROW(read_image(path("film.dpx"), ColorSpace::linear_data));
}

// An image of 3 x 2 pixels, stored so that each EXIF orientation shows 1 2 3 / 4 5 6.
TEST_F(ImageFiles, AreTurnedAsTheirOrientationSays) {
    const std::vector<std::vector<uint8_t>> stored = {
        {1, 2, 3, 4, 5, 6}, {3, 2, 1, 6, 5, 4}, {6, 5, 4, 3, 2, 1}, {4, 5, 6, 1, 2, 3},
        {1, 4, 2, 5, 3, 6}, {3, 6, 2, 5, 1, 4}, {6, 3, 5, 2, 4, 1}, {4, 1, 5, 2, 6, 3}};
    for (int orientation = 1; orientation <= 8; ++orientation) {
        const bool swapped = orientation >= 5;
        OIIO::ImageSpec spec(swapped ? 2 : 3, swapped ? 3 : 2, 1, OIIO::TypeDesc::UINT8);
        spec.attribute("Orientation", orientation);
        const auto output = OIIO::ImageOutput::create("tiff");
        ASSERT_TRUE(output->open(path("a.tif"), spec));
        ASSERT_TRUE(output->write_image(OIIO::TypeDesc::UINT8, stored[size_t(orientation - 1)].data()));
        ASSERT_TRUE(output->close());
        const Image image = read_image(path("a.tif"), ColorSpace::linear_data);
        const ImageHeader header = image_header(path("a.tif"));
        EXPECT_EQ(image.width, 3);
        EXPECT_EQ(image.height, 2);
        EXPECT_EQ(header.width, 3);
        EXPECT_EQ(header.height, 2);
        EXPECT_EQ(image.turned, orientation > 1);
        for (size_t i = 0; i < 6; ++i)
            EXPECT_FLOAT_EQ(image.pixels[i] * 255.0F, float(i + 1)) << orientation << ", pixel " << i;
    }
}

// Refused by their first bytes, so that no reader of another format takes minutes over them.
TEST_F(ImageFiles, OfNoDocumentedFormatAreRefusedAtOnce) {
    std::string dicom(1000, '\0');
    dicom.replace(128, 4, "DICM");
    for (const std::string& bytes :
         {std::string(1000, '\0'), dicom, std::string("RIFF\4\0\0\0WAVE", 12), std::string("B")})
        for (const char* name : {"a.png", "a.exr", "a.dcm", "a"}) {
            put(name, bytes);
            EXPECT_NE(message_of(path(name)).find("begins like none of the formats that are read"),
                      std::string::npos);
            EXPECT_FALSE(read_metadata(path(name), "Software"));
        }
    put("a.tif", std::string("II*\0", 4) + std::string(1000, '\0')); // its own reader alone is tried
    EXPECT_NE(message_of(path("a.tif")).find("is not an image that can be read"), std::string::npos);
}

// Nobody writes to this pipe: opening it would wait without end.
TEST_F(ImageFiles, ThatArePipesAreRefused) {
    ASSERT_EQ(::mkfifo(path("a.png").c_str(), 0600), 0);
    EXPECT_NE(message_of(path("a.png")).find("is not an ordinary file"), std::string::npos);
    EXPECT_FALSE(read_metadata(path("a.png"), "Software"));
    EXPECT_FALSE(whole_metadata(path("a.png"), "Software"));
    EXPECT_THROW(image_header(path("a.png")), InputError);
    EXPECT_NE(message_of("/dev/zero").find("is not an ordinary file"), std::string::npos);
}

// For FITS in colour OpenImageIO names only one of three channels, and aborts if the others' names are looked
// up.
TEST_F(ImageFiles, ChannelsWithoutNamesAreGivenSome) {
    std::string header;
    const auto card = [&](const std::string& text) { header += text + std::string(80 - text.size(), ' '); };
    for (const char* text : {"SIMPLE  =                    T", "BITPIX  =                    8",
                             "NAXIS   =                    3", "NAXIS1  =                    3",
                             "NAXIS2  =                    4", "NAXIS3  =                    2", "END"})
        card(text);
    header.resize(2880, ' '); // FITS uses blocks of this size
    put("colour.fits", header + std::string(2880, '\x40'));
    const Image image = read_image(path("colour.fits"));
    EXPECT_EQ(image.channel_names, (std::vector<std::string>{"R", "G", "B"}));
    EXPECT_EQ(image.pixels.size(), 4U * 2U * 3U);
    EXPECT_EQ(image_header(path("colour.fits")).channels, 3);
}

// The PNG library prints errors itself: damaged files must be refused before it sees them, for every request.
TEST_F(ImageFiles, DamagedPngsAreNotOpened) {
    write_bytes(path("a.png"), std::vector<uint8_t>(12, 100), "sRGB");
    std::string header = get("a.png"), signature = header;
    header[19] = char(header[19] ^ 0x40); // width in IHDR
    signature[4] = '\n';                  // as after a transfer in text mode
    for (const std::string& bytes : {header, signature}) {
        put("damaged.png", bytes);
        testing::internal::CaptureStderr();
        EXPECT_THROW(image_header(path("damaged.png")), InputError);
        EXPECT_THROW(read_image(path("damaged.png")), InputError);
        EXPECT_THROW(read_all_metadata(path("damaged.png")), InputError);
        EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    }
}

// A crop would be stretched over the whole frame.
TEST_F(ImageFiles, CropsAreRefused) {
    for (const int more : {-2, 0, 3}) {
        OIIO::ImageSpec spec(8, 4, 3, OIIO::TypeDesc::HALF);
        spec.full_width = 8 + more;
        const std::vector<float> pixels(8 * 4 * 3, 0.5f);
        const auto output = OIIO::ImageOutput::create("crop.exr");
        ASSERT_TRUE(output->open(path("crop.exr"), spec) &&
                    output->write_image(OIIO::TypeDesc::FLOAT, pixels.data()) && output->close());
        EXPECT_EQ(message_of(path("crop.exr")).find("do not fill its frame") != std::string::npos, more != 0);
    }
    OIIO::ImageSpec spec(8, 4, 3, OIIO::TypeDesc::HALF);
    spec.x = 4; // as large as the frame, but beside it
    const std::vector<float> pixels(8 * 4 * 3, 0.5f);
    const auto output = OIIO::ImageOutput::create("crop.exr");
    ASSERT_TRUE(output->open(path("crop.exr"), spec) &&
                output->write_image(OIIO::TypeDesc::FLOAT, pixels.data()) && output->close());
    EXPECT_NE(message_of(path("crop.exr")).find("do not fill its frame"), std::string::npos);
}

// An EXR of many blocks, one of them damaged: --resume must not take it for complete.
TEST_F(ImageFiles, MetadataOfFilesDamagedInTheMiddleIsNotTrusted) {
    std::vector<float> pixels(64 * 640 * 3);
    std::mt19937 random(5);
    for (float& v : pixels) v = float(random() % 1000);
    const Layer layers[] = {{"", {"R", "G", "B"}, pixels.data(), true}};
    const Metadata metadata[] = {{"marram:digest", "x"}};
    write_exr(path("a.exr"), 64, 640, layers, metadata);
    ASSERT_EQ(whole_metadata(path("a.exr"), "marram:digest"), "x");
    std::string bytes = get("a.exr");
    for (size_t i = bytes.size() / 2; i < bytes.size() / 2 + 4000; ++i) bytes[i] = char(0xa5);
    put("spoilt.exr", bytes);
    EXPECT_EQ(whole_metadata(path("spoilt.exr"), "marram:digest"), std::nullopt);
}

TEST_F(ImageFiles, PngHoldsSrgbOfExposedPixels) {
    const float pixels[] = {0.0f, 0.5f, 1.0f, -1.0f, 7.0f, 0.0031308f, NAN, INFINITY, 0.25f};
    write_png(path("a.png"), 3, 1, 3, pixels, 0.0);
    const Image data = read_image(path("a.png"), ColorSpace::linear_data);
    const int expected[] = {0, 188, 255, 0, 255, 10, 0, 255, 137};
    for (size_t i = 0; i < 9; ++i) EXPECT_EQ(std::lround(data.pixels[i] * 255.0f), expected[i]) << i;
    EXPECT_NEAR(read_image(path("a.png"), ColorSpace::color).pixels[1], 0.5f, 0.005f);

    write_png(path("b.png"), 3, 1, 3, pixels, 1.0);
    EXPECT_EQ(std::lround(read_image(path("b.png"), ColorSpace::linear_data).pixels[8] * 255.0f), 188);

    const float half_covered[] = {0.25f, 0.0f, 0.5f, 0.5f}; // premultiplied, as in the film
    const Metadata said[] = {{"marram:digest", std::string("abc")}, {"marram:samples", 7}};
    write_png(path("said.png"), 3, 1, 3, pixels, 0.0, said);
    EXPECT_EQ(read_metadata(path("said.png"), "marram:digest"), "abc");
    EXPECT_EQ(read_metadata(path("said.png"), "marram:samples"), "7");
    EXPECT_EQ(read_metadata(path("said.png"), "marram:other"), std::nullopt);
    write_png(path("c.png"), 1, 1, 4, half_covered, 0.0);
    const Image apart = read_image(path("c.png"), ColorSpace::linear_data);
    EXPECT_EQ(std::lround(apart.pixels[0] * 255.0f), 188);
    EXPECT_EQ(std::lround(apart.pixels[2] * 255.0f), 255);
    EXPECT_EQ(std::lround(apart.pixels[3] * 255.0f), 128);
}

TEST_F(ImageFiles, PixelsThatAreNotFiniteAreNamed) {
    std::vector<float> pixels(8 * 4 * 3, 1.0f);
    pixels[(2 * 8 + 5) * 3 + 1] = NAN;
    const Layer layers[] = {{"", {"R", "G", "B"}, pixels.data(), false}};
    write_exr(path("nan.exr"), 8, 4, layers, {});
    EXPECT_NE(message_of(path("nan.exr")).find("channel G of pixel (5, 2) is not a number"),
              std::string::npos);
}

TEST(BrokenImages, AreRefused) {
    const fs::path folder = fs::path(MARRAM_SOURCE_DIR) / "tests/broken/images";
    std::ifstream table(folder / "expected.txt");
    int count = 0;
    for (std::string row; std::getline(table, row); ++count) {
        const std::string name = row.substr(0, row.find('\t')), expected = row.substr(row.find('\t') + 1);
        ASSERT_TRUE(fs::exists(folder / name)) << name;
        const std::string message = message_of((folder / name).string());
        EXPECT_NE(message.find(expected), std::string::npos) << name << ": " << message;
        EXPECT_EQ(message.find('\n'), std::string::npos);
    }
    EXPECT_GE(count, 5);
    EXPECT_NE(message_of("no/such.png").find("there is no such file"), std::string::npos);
    EXPECT_NE(message_of(folder.string()).find("not an ordinary file"), std::string::npos);
}

TEST_F(ImageFiles, MutationsNeverDoWorseThanAnInputError) {
    std::vector<float> pixels(16 * 16 * 3);
    std::mt19937 random(11);
    for (float& v : pixels) v = float(random() % 256) / 255.0f;
    write_png(path("seed.png"), 16, 16, 3, pixels.data(), 0.0);
    const std::string seed = get("seed.png");
    for (int round = 0; round < 300; ++round) {
        std::string bytes = seed;
        for (unsigned edits = 1 + random() % 4; edits-- > 0 && !bytes.empty();) {
            const size_t at = random() % bytes.size();
            if (random() % 4 == 0)
                bytes.resize(at);
            else if (random() % 4 == 0)
                bytes.erase(at, random() % 8);
            else
                bytes[at] = char(random());
        }
        put("m.png", bytes);
        try {
            const Image image = read_image(path("m.png"));
            EXPECT_EQ(image.pixels.size(),
                      size_t(image.width) * size_t(image.height) * size_t(image.channels));
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find("m.png"), std::string::npos);
        }
        (void)read_metadata(path("m.png"), "Software");
    }
}

// ---- Atomic output ----------------------------------------------------------------------------------------

TEST_F(ImageFiles, OutputsThatCannotBeWrittenAreRefusedEarly) {
    put("file", "x");
    fs::create_directory(folder / "sub");
    const std::string long_name = path((std::string(252, 'n') + ".png").c_str());
    for (const std::string& bad :
         {std::string(), path("none/a.exr"), path("file/a.exr"), path("sub"), path("sub/"),
          std::string("/dev/null"), std::string("/proc/marram.exr"), long_name})
        EXPECT_THROW(check_writable(bad), InputError) << bad;
    EXPECT_NO_THROW(check_writable(path("new.exr")));
    EXPECT_FALSE(fs::exists(folder / "new.exr"));
    EXPECT_EQ(count(), 2u);
    const float pixel[3] = {0, 0, 0};
    const Layer layers[] = {{"", {"R", "G", "B"}, pixel, true}};
    EXPECT_THROW(write_exr(path("none/a.exr"), 1, 1, layers, {}), InputError);
    EXPECT_THROW(write_png("/proc/a.png", 1, 1, 3, pixel, 0.0), InputError);
}

TEST_F(ImageFiles, ExistingFilesSurviveFailure) {
    put("old.png", "the old picture");
    try {
        AtomicFile writer(path("old.png"));
        writer.write("half of a new");
        EXPECT_EQ(get("old.png"), "the old picture");
        throw std::runtime_error("interrupted");
    } catch (const std::runtime_error&) {
    }
    EXPECT_EQ(get("old.png"), "the old picture");
    EXPECT_EQ(count(), 1u);
    AtomicFile writer(path("old.png"));
    writer.write("new");
    writer.commit();
    EXPECT_EQ(get("old.png"), "new");
    EXPECT_EQ(count(), 1u);
}

TEST_F(ImageFiles, LinksStayLinksAndFullDisksAreReported) {
    put("real.txt", "old");
    fs::create_symlink(folder / "real.txt", folder / "link.txt");
    AtomicFile writer(path("link.txt"));
    writer.write("new");
    writer.commit();
    EXPECT_TRUE(fs::is_symlink(folder / "link.txt"));
    EXPECT_EQ(get("real.txt"), "new");
}

} // namespace
} // namespace marram
