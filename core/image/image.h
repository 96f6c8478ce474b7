// SPDX-License-Identifier: Apache-2.0
// Reads and writes pictures through OpenImageIO. Values are linear floats in memory. Files are written
// completely or not at all (core/image/atomic_file.h). Every problem with a file is an InputError that names
// it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace marram {

struct Image {
    int width = 0, height = 0, channels = 0;
    std::vector<float> pixels; // rows from the top, channels interleaved
    std::vector<std::string> channel_names;
    bool as_in_file = true;         // false: colours were decoded to linear
    bool turned = false;            // the file's rows were reordered, by its EXIF orientation
    bool half = false;              // R (else the first channel) is stored as half float
    std::string read_as = "linear"; // assumed encoding of the colours; also "sRGB", "gamma 1.8"
    bool straight_alpha = false;    // colour is not multiplied by alpha; always so for PNG
    // The number in the file that is read as 1: 65535 for 16 bits, 1 for floats.
    double stored_one = 1.0;
    bool stored_signed = true; // false for unsigned integers
};

enum class ColorSpace {
    linear_data, // values as in the file, integers scaled to 0 ... 1
    raw_data,    // the same, and pixels that are not finite are no error
    // Colour is made linear. It is decoded as sRGB if the file says so, if OpenImageIO reports Rec709 (its
    // name for PPM files, which hold sRGB; not for floats), or if it has 8 bits and no colour space. It is
    // decoded with a gamma if the file states one (PNG's gAMA, TGA; a PNG's gAMA of 1/2.2 alone means sRGB,
    // as in libpng). Files that are marked linear, or have more bits and no colour space, are used as they
    // are. Other colour spaces are errors.
    color,
};

// The sRGB transfer functions (IEC 61966-2-1), odd-symmetric below zero and extended above one.
float srgb_from_linear(float linear);
float linear_from_srgb(float encoded);

// Reads EXR, PNG, TIFF, JPEG, Radiance HDR, PNM, PFM, TGA, BMP, GIF, WebP, FITS, DPX, Cineon, PSD, JPEG 2000 and DDS; the
// first picture of a file with several, at full resolution. Rows are in the order in which the picture is to be seen (EXIF
// orientation; so are the sizes of image_header).
// Alpha is as in the file and is never multiplied into colour. Errors: missing, unreadable or truncated
// files, deep and volume images, crops and overscan, sides above 65536 pixels, more than 1 GiB of floats,
// non-finite pixels.
Image read_image(const std::string& path, ColorSpace space = ColorSpace::color);

// Throws InputError that names the first pixel that is not finite.
void check_finite(const std::string& path, const Image& image);

// One layer of an EXR. Channels of the layer "" are written under their own names, others as "name.channel".
struct Layer {
    std::string name;
    std::vector<std::string> channels; // "R", "G", "B", "A", "Z", ...
    const float* pixels = nullptr;     // width * height * channels.size(), interleaved, rows from the top
    bool half = true;                  // 16-bit float; false, for depth and ids: 32-bit
};

using Metadata = std::pair<std::string, std::variant<std::string, int, double>>;

// ZIP compression. The bytes depend on the arguments only. Half layers are clamped to the largest half,
// 65504, so that finite pixels stay finite.
void write_exr(const std::string& path, int width, int height, std::span<const Layer> layers,
               std::span<const Metadata> metadata);

// The file that write_png would write, in memory.
std::vector<unsigned char> png_bytes(int width, int height, int channels, const float* pixels,
                                     double exposure_stops);

// 8-bit sRGB of linear `pixels` (3 channels, or 4 with colour multiplied by alpha) times 2^exposure_stops,
// clamped, without dither. NaN becomes 0.
void write_png(const std::string& path, int width, int height, int channels, const float* pixels,
               double exposure_stops, std::span<const Metadata> metadata = {});

// Lossless single-channel files: a 16-bit PNG, marked as linear, with metadata as texts; a TIFF of 32-bit
// floats, not compressed. The bytes depend on the arguments only.
void write_grey_png(const std::string& path, int width, int height, const uint16_t* pixels,
                    std::span<const Metadata> metadata);
void write_grey_tiff(const std::string& path, int width, int height, const float* pixels,
                     const std::string& description);

// From a file's header: whether it holds one whole picture, several (pages, parts), or one whose pixels do
// not fill its frame exactly.
enum class Extent { whole, several, cropped };
struct ImageHeader {
    Extent extent = Extent::whole;
    int width = 0, height = 0, channels = 0;
};
ImageHeader image_header(const std::string& path); // throws InputError if it cannot be opened

// All metadata of an image as text (numbers with the fewest digits that round-trip), sorted by name. Throws
// InputError if it cannot be opened.
std::vector<std::pair<std::string, std::string>> read_all_metadata(const std::string& path);

// One metadata value of an image as text (numbers with the fewest digits that round-trip). nullopt if the
// file is missing or not an image, or has no such key. Never throws. Reads only the header.
std::optional<std::string> read_metadata(const std::string& path, const std::string& key);

// The same, but nullopt also if the picture is damaged or truncated. Reads all of it, in strips.
std::optional<std::string> whole_metadata(const std::string& path, const std::string& key);

} // namespace marram
