// SPDX-License-Identifier: Apache-2.0
// Pictures in and out, through OpenImageIO. Values are linear floats in memory; files are written whole or
// not at all (core/image/atomic_file.h). Everything wrong with a file is an InputError that names it.
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
    bool as_in_file = true;         // false: colours were encoded in the file and have been made linear
    bool half = false;              // stored as half floats, the first channel at least
    std::string read_as = "linear"; // what the file's colours were taken for: "sRGB", "gamma 1.8", "linear"
    bool straight_alpha = false;    // colour is not multiplied by alpha: always so in PNG
};

enum class ColorSpace {
    linear_data, // values as they stand in the file, integers scaled to 0 ... 1
    // Colour is made linear: from sRGB (said so in the file; or Rec709, as OpenImageIO calls the colours of PPM files,
    // which hold sRGB; or 8 bits and nothing said), or from a power that the file states (PNG's gAMA, TGA; a PNG's
    // gAMA of 1/2.2 alone is sRGB's, as libpng has it). Files that say they are linear, and those of more bits that say nothing, are
    // taken as they are; other spaces are refused.
    color,
};

// The sRGB transfer functions (IEC 61966-2-1), odd-symmetric below zero and continued above one.
float srgb_from_linear(float linear);
float linear_from_srgb(float encoded);

// Reads any format that OpenImageIO knows; the first picture of files that hold several, at full resolution.
// Alpha is as in the file and is never multiplied into colour. Refused: missing, unreadable or truncated
// files, deep and volume images, crops (fewer or more pixels than the frame has), sizes above 65536 or 1 GiB of floats,
// pixels that are not finite.
Image read_image(const std::string& path, ColorSpace space = ColorSpace::color);

// One layer of an EXR. The channels of the layer "" are written under their own names, those of others as
// "name.channel".
struct Layer {
    std::string name;
    std::vector<std::string> channels; // "R", "G", "B", "A", "Z", ...
    const float* pixels = nullptr;     // width * height * channels.size(), interleaved, rows from the top
    bool half = true;                  // 16-bit float; false, for depth and ids: 32-bit
};

using Metadata = std::pair<std::string, std::variant<std::string, int, double>>;

// ZIP compression. The bytes depend on the arguments alone. Half layers are clamped to the largest half,
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

// One channel, to the bit: 16-bit PNG, marked as linear, its metadata as texts; TIFF of 32-bit floats, not compressed. The bytes depend on
// the arguments alone.
void write_grey_png(const std::string& path, int width, int height, const uint16_t* pixels,
                    std::span<const Metadata> metadata);
void write_grey_tiff(const std::string& path, int width, int height, const float* pixels,
                     const std::string& description);

// What a file's header says: whether it holds more than one picture (pages, parts), or one whose pixels do not fill its frame exactly.
enum class Extent { whole, several, cropped };
struct ImageHeader {
    Extent extent = Extent::whole;
    int width = 0, height = 0, channels = 0;
};
ImageHeader image_header(const std::string& path); // throws InputError where it cannot be opened

// Every metadata entry of an image, as text (numbers in the fewest digits that give them back), by name. Throws InputError where it cannot be opened.
std::vector<std::pair<std::string, std::string>> read_all_metadata(const std::string& path);

// The value of a metadata entry of an image, as text (numbers in the fewest digits that give them back); nullopt where the file is
// missing or no image, or the key is not there. Never throws. Reads the header.
std::optional<std::string> read_metadata(const std::string& path, const std::string& key);

// The same of a finished picture: nullopt also where it is damaged or cut short. Reads it all, in strips.
std::optional<std::string> whole_metadata(const std::string& path, const std::string& key);

} // namespace marram
