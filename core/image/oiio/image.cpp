// SPDX-License-Identifier: Apache-2.0
#include "core/image/image.h"

#include "core/image/oiio/image_input.h"
#include "core/image/oiio/image_output.h"
#include "core/image/png_check.h"
#include "core/math/problem.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

namespace marram {

namespace {

constexpr int max_side = 65536;
constexpr int64_t max_bytes = int64_t(1) << 30; // limit for the floats in memory
constexpr int strip_rows = 256;                 // rows converted at a time; a multiple of EXR's 16-row blocks
constexpr float max_half = 65504.0f;

using InputFile = std::unique_ptr<OIIO::ImageInput>;

[[noreturn]] void refuse_image(const std::string& path, const std::string& what, const std::string& fix) {
    throw InputError(Place{path}, what, fix);
}

// OpenImageIO's error message, first line only.
std::string reason(const std::string& message) {
    std::string text = message.empty() ? "no reason given" : message.substr(0, message.find('\n'));
    return "(" + text + ")";
}

// libpng prints its errors to stderr, besides passing them to OpenImageIO, which gives no way to disable
// this: stderr is redirected to /dev/null while a PNG is read. Only for PNG files, and not while rendering,
// since messages of other threads are lost too.
class QuietPng {
  public:
    explicit QuietPng(const std::string& path) {
        if (format_of(path) != "png") return;
        lock_ = std::unique_lock(mutex());
        std::fflush(stderr);
        stderr_ = ::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 3);
        const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
        if (stderr_ >= 0 && nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
        if (nowhere >= 0) ::close(nowhere);
    }
    ~QuietPng() {
        if (stderr_ < 0) return;
        std::fflush(stderr);
        ::dup2(stderr_, STDERR_FILENO);
        ::close(stderr_);
    }
    QuietPng(const QuietPng&) = delete;
    QuietPng& operator=(const QuietPng&) = delete;

  private:
    static std::mutex& mutex() {
        static std::mutex one;
        return one;
    }
    std::unique_lock<std::mutex> lock_;
    int stderr_ = -1;
};

void check_is_file(const std::string& path) {
    std::error_code error;
    const std::filesystem::file_status status = std::filesystem::status(path, error);
    if (!std::filesystem::exists(status)) refuse_image(path, "there is no such file", "check the path");
    if (!std::filesystem::is_regular_file(status))
        refuse_image(path, "is not an ordinary file", "give the path of an image");
    if (std::filesystem::file_size(path, error) == 0 || error)
        refuse_image(path, "the file is empty", "save the image again");
}

[[noreturn]] void refuse_truncated(const std::string& path, const std::string& message) {
    refuse_image(path, "cannot be read to its end, it is truncated or damaged " + reason(message),
                 "save or copy the image again");
}

InputFile open_image(const std::string& path) {
    check_is_file(path);
    // Checked first: libpng prints errors already when it opens a file.
    if (const std::string fault = png_fault(path); !fault.empty()) refuse_truncated(path, fault);
    OIIO::ImageSpec config;
    // Otherwise 8-bit colour would be multiplied by alpha and rounded.
    config.attribute("oiio:UnassociatedAlpha", 1);
    std::string why;
    InputFile input = open_format(path, config, why);
    if (!input)
        refuse_image(path, "is not an image that can be read (" + why + ")",
                     "save it again as EXR, PNG, TIFF or JPEG");
    return input;
}

// For some files (FITS) OpenImageIO reports more channels than names, and its own look-up of a name would
// abort.
OIIO::ImageSpec spec_of(const OIIO::ImageInput& input) {
    OIIO::ImageSpec spec = input.spec();
    if (spec.channelnames.size() != size_t(std::max(0, spec.nchannels))) spec.default_channel_names();
    return spec;
}

bool fills_frame(const OIIO::ImageSpec& spec) {
    return spec.x == spec.full_x && spec.y == spec.full_y && spec.width == spec.full_width &&
           spec.height == spec.full_height;
}

void check_spec(const std::string& path, const OIIO::ImageSpec& spec) {
    if (spec.deep || spec.depth > 1)
        refuse_image(path, "is a deep or volume image", "save it as a flat image");
    if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1)
        refuse_image(path, "has no pixels", "save the image again");
    if (spec.width > max_side || spec.height > max_side)
        refuse_image(path,
                     fmt::format("is {} x {} pixels, more than {} a side", spec.width, spec.height, max_side),
                     "make it smaller");
    if (!fills_frame(spec))
        refuse_image(
            path,
            fmt::format("has {} x {} pixels at ({}, {}) that do not fill its frame of {} x {} at ({}, {})",
                        spec.width, spec.height, spec.x, spec.y, spec.full_width, spec.full_height,
                        spec.full_x, spec.full_y),
            "save one whole picture, its crop removed, to a file of its own");
    const int64_t bytes = int64_t(spec.width) * spec.height * spec.nchannels * int64_t(sizeof(float));
    if (bytes > max_bytes)
        refuse_image(path, fmt::format("takes {} MiB in memory, more than {}", bytes >> 20, max_bytes >> 20),
                     "make it smaller");
}

constexpr float srgb = 0.0f; // special exponent value

// A PNG gAMA that means sRGB, without an sRGB chunk (ImageMagick writes these): 45455 in units of 1e-5, which
// libpng treats as sRGB; 500 units of tolerance for rounding.
bool is_srgb_gamma(std::string_view format, float exponent) {
    return format == "png" && std::fabs(1.0f / exponent - 0.45455f) <= 0.005f;
}

// Exponent that turns the colours of a file into linear light: 1 if they are linear, `srgb` for sRGB.
float exponent_of(const std::string& path, const OIIO::ImageSpec& spec, std::string_view format) {
    using OIIO::Strutil::iequals;
    using OIIO::Strutil::istarts_with;
    const std::string space = spec.get_string_attribute("oiio:ColorSpace");
    if (space.empty()) return spec.format == OIIO::TypeDesc::UINT8 ? srgb : 1.0f;
    if (iequals(space, "sRGB")) return srgb;
    // OpenImageIO reports Rec709 for all PNM files. PFM holds floats: not encoded for a display.
    if (iequals(space, "Rec709")) return spec.format.is_floating_point() ? 1.0f : srgb;
    for (const char* linear : {"linear", "lin_", "scene_linear", "sRGB-linear", "ACEScg", "ACES2065"})
        if (istarts_with(space, linear)) return 1.0f;
    if (istarts_with(space, "gamma")) { // "Gamma2.2", whose digits are rounded, or "GammaCorrected1.8"
        const size_t digit = space.find_first_of("0123456789");
        const float named = digit == std::string::npos ? 0.0f : OIIO::Strutil::stof(space.substr(digit));
        const float exponent = spec.get_float_attribute("oiio:Gamma", named);
        if (exponent >= 1.0f && std::isfinite(exponent))
            return is_srgb_gamma(format, exponent) ? srgb : exponent; // below 1: inverted, an error
    }
    refuse_image(path, "is in the colour space \"" + space + "\", which is not known here",
                 "save it again as sRGB, or linear");
}

void make_linear(Image& image, int alpha_channel, float exponent) {
    for (size_t i = 0; i < image.pixels.size(); ++i) {
        if (int(i % size_t(image.channels)) == alpha_channel) continue;
        float& value = image.pixels[i];
        value = exponent == srgb ? linear_from_srgb(value)
                                 : std::copysign(std::pow(std::fabs(value), exponent), value);
    }
    image.as_in_file = false;
}

// EXIF: 1 as it is, 2 mirrored left to right, 3 turned by half, 4 upside down, 5 mirrored along the diagonal
// from the top left, 6 to be turned clockwise to be upright, 7 mirrored along the other diagonal, 8 to be
// turned anticlockwise.
int orientation_of(const OIIO::ImageSpec& spec) {
    const int orientation = spec.get_int_attribute("Orientation", 1);
    return orientation >= 2 && orientation <= 8 ? orientation : 1;
}

bool swaps_sides(int orientation) { return orientation >= 5; }

// Puts the rows from top to bottom as the picture is to be seen.
void make_upright(Image& image, int orientation) {
    if (orientation == 1) return;
    const std::vector<float> stored = std::exchange(image.pixels, {});
    const size_t stored_width = size_t(image.width), stored_height = size_t(image.height),
                 channels = size_t(image.channels);
    if (swaps_sides(orientation)) std::swap(image.width, image.height);
    const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    image.pixels.reserve(stored.size());
    for (size_t y = 0; y < size_t(image.height); ++y)
        for (size_t x = 0; x < size_t(image.width); ++x) {
            const size_t along = swaps_sides(orientation) ? y : x, down = swaps_sides(orientation) ? x : y;
            const size_t i = from_right ? stored_width - 1 - along : along,
                         j = from_bottom ? stored_height - 1 - down : down;
            const float* pixel = stored.data() + (j * stored_width + i) * channels;
            image.pixels.insert(image.pixels.end(), pixel, pixel + channels);
        }
    image.turned = true;
}

// OpenImageIO reads the greatest integer as 1.
double stored_one(OIIO::TypeDesc format) {
    if (format.is_floating_point()) return 1.0;
    const double bits = 8.0 * double(format.basesize());
    return std::exp2(format.is_signed() ? bits - 1.0 : bits) - 1.0;
}

// libjpeg fills the rest of a truncated file with grey without an error: check the end marker.
bool jpeg_is_whole(const std::string& path) {
    std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
    constexpr int tail_bytes = 4096; // some cameras pad after the marker
    if (!file || std::fseek(file.get(), 0, SEEK_END) != 0) return false;
    const long size = std::ftell(file.get());
    std::fseek(file.get(), std::max(0L, size - tail_bytes), SEEK_SET);
    std::string tail(tail_bytes, '\0');
    tail.resize(std::fread(tail.data(), 1, tail.size(), file.get()));
    return tail.find("\xff\xd9") != std::string::npos;
}

} // namespace

Image read_image(const std::string& path, ColorSpace space) {
    const QuietPng quiet(path);
    InputFile input = open_image(path);
    const OIIO::ImageSpec spec = spec_of(*input);
    const std::string_view format = input->format_name();
    check_spec(path, spec);
    Image image;
    image.width = spec.width;
    image.height = spec.height;
    image.channels = spec.nchannels;
    for (int c = 0; c < spec.nchannels; ++c) image.channel_names.push_back(spec.channel_name(c));
    image.half = spec.channelformat(std::max(0, spec.channelindex("R"))) == OIIO::TypeDesc::HALF;
    image.stored_one = stored_one(spec.format);
    image.stored_signed = spec.format.is_floating_point() || spec.format.is_signed();
    image.pixels.resize(size_t(spec.width) * size_t(spec.height) * size_t(spec.nchannels));
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, image.pixels.data()))
        refuse_truncated(path, input->geterror());
    if (input->has_error()) refuse_truncated(path, input->geterror());
    if (format == "jpeg" && !jpeg_is_whole(path)) refuse_truncated(path, "its end marker is missing");
    image.straight_alpha =
        spec.alpha_channel >= 0 && (format == "png" || spec.get_int_attribute("oiio:UnassociatedAlpha") != 0);
    if (space == ColorSpace::color)
        if (const float exponent = exponent_of(path, spec, format); exponent != 1.0f) {
            make_linear(image, spec.alpha_channel, exponent);
            image.read_as = exponent == srgb ? "sRGB" : fmt::format("gamma {:.3g}", exponent);
        }
    make_upright(image, orientation_of(spec));
    if (space != ColorSpace::raw_data) check_finite(path, image);
    return image;
}

// ---- Writing

namespace {

OIIO::ImageSpec exr_spec(int width, int height, std::span<const Layer> layers,
                         std::span<const Metadata> metadata) {
    OIIO::ImageSpec spec(width, height, 0, OIIO::TypeDesc::FLOAT);
    spec.channelnames.clear();
    for (const Layer& layer : layers)
        for (const std::string& channel : layer.channels) {
            spec.channelnames.push_back(layer.name.empty() ? channel : layer.name + "." + channel);
            spec.channelformats.push_back(layer.half ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT);
            if (spec.channelnames.back() == "A") spec.alpha_channel = spec.nchannels;
            if (spec.channelnames.back() == "Z") spec.z_channel = spec.nchannels;
            ++spec.nchannels;
        }
    spec.attribute("compression", "zip");
    spec.attribute("DateTime", ""); // else OpenImageIO writes the current time, and files differ
    for (const auto& [key, value] : metadata) {
        if (const auto* text = std::get_if<std::string>(&value)) spec.attribute(key, *text);
        if (const int* number = std::get_if<int>(&value)) spec.attribute(key, *number);
        if (const double* number = std::get_if<double>(&value))
            spec.attribute(key, OIIO::TypeDesc::DOUBLE, number);
    }
    return spec;
}

// Rows [begin, end) of all layers, channels interleaved as in the file.
void interleave(std::span<const Layer> layers, int width, int channels, int begin, int end,
                std::vector<float>& strip) {
    size_t offset = 0;
    for (const Layer& layer : layers) {
        const size_t count = layer.channels.size();
        const float* from = layer.pixels + size_t(begin) * size_t(width) * count;
        const size_t pixels = size_t(end - begin) * size_t(width);
        for (size_t i = 0; i < pixels; ++i)
            for (size_t c = 0; c < count; ++c) {
                const float value = from[i * count + c];
                // clamp leaves a NaN unchanged: both comparisons fail.
                strip[i * size_t(channels) + offset + c] =
                    layer.half ? std::clamp(value, -max_half, max_half) : value;
            }
        offset += count;
    }
}

uint8_t to_byte(double encoded) {
    if (!(encoded > 0.0)) return 0;
    return uint8_t(std::min(encoded, 1.0) * 255.0 + 0.5);
}

std::vector<uint8_t> to_bytes(int width, int height, int channels, const float* pixels,
                              double exposure_stops) {
    const size_t count = size_t(width) * size_t(height);
    const float scale = float(std::exp2(exposure_stops));
    std::vector<uint8_t> bytes(count * size_t(channels));
    for (size_t i = 0; i < count; ++i) {
        const float* from = pixels + i * size_t(channels);
        uint8_t* to = bytes.data() + i * size_t(channels);
        const float alpha = channels == 4 ? from[3] : 1.0f;
        // PNG colour is not multiplied by alpha: divide. If alpha is 0 in the file, the colour is added light
        // only: keep it.
        const float apart = to_byte(alpha) > 0 && alpha < 1.0f ? scale / alpha : scale;
        for (int c = 0; c < 3; ++c) to[c] = to_byte(srgb_from_linear(from[c] * apart));
        if (channels == 4) to[3] = to_byte(alpha);
    }
    return bytes;
}

} // namespace

void write_exr(const std::string& path, int width, int height, std::span<const Layer> layers,
               std::span<const Metadata> metadata) {
    assert(width > 0 && height > 0 && !layers.empty());
    const OIIO::ImageSpec spec = exr_spec(width, height, layers, metadata);
    ImageWriter writer(path, spec, "openexr");
    std::vector<float> strip(size_t(std::min(height, strip_rows)) * size_t(width) * size_t(spec.nchannels));
    for (int begin = 0; begin < height; begin += strip_rows) {
        const int end = std::min(height, begin + strip_rows);
        interleave(layers, width, spec.nchannels, begin, end, strip);
        writer.write_rows(begin, end, OIIO::TypeDesc::FLOAT, strip.data());
    }
    writer.commit();
}

namespace {

void add_texts(OIIO::ImageSpec& spec, std::span<const Metadata> metadata) { // PNG metadata is text only
    for (const auto& [key, value] : metadata)
        spec.attribute(key, std::visit([](const auto& v) { return fmt::format("{}", v); }, value));
}

OIIO::ImageSpec png_spec(int width, int height, int channels, std::span<const Metadata> metadata) {
    assert(width > 0 && height > 0 && (channels == 3 || channels == 4));
    OIIO::ImageSpec spec(width, height, channels, OIIO::TypeDesc::UINT8);
    spec.attribute("oiio:ColorSpace", "sRGB");
    add_texts(spec, metadata);
    spec.attribute("oiio:UnassociatedAlpha", 1); // we divide by alpha, before rounding
    return spec;
}

} // namespace

std::vector<unsigned char> png_bytes(int width, int height, int channels, const float* pixels,
                                     double exposure_stops) {
    std::vector<unsigned char> file;
    OIIO::Filesystem::IOVecOutput memory(file);
    OIIO::ImageSpec spec = png_spec(width, height, channels, {});
    OIIO::Filesystem::IOProxy* proxy = &memory;
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    const std::vector<uint8_t> bytes = to_bytes(width, height, channels, pixels, exposure_stops);
    const std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create("png");
    const bool written = output && output->open("memory.png", spec) &&
                         output->write_image(OIIO::TypeDesc::UINT8, bytes.data()) && output->close();
    if (!written) refuse_image("memory.png", "could not be made", "check OpenImageIO's PNG support");
    return file;
}

void write_png(const std::string& path, int width, int height, int channels, const float* pixels,
               double exposure_stops, std::span<const Metadata> metadata) {
    const OIIO::ImageSpec spec = png_spec(width, height, channels, metadata);
    const std::vector<uint8_t> bytes = to_bytes(width, height, channels, pixels, exposure_stops);
    ImageWriter writer(path, spec, "png");
    writer.write_rows(0, height, OIIO::TypeDesc::UINT8, bytes.data());
    writer.commit();
}

void write_grey_png(const std::string& path, int width, int height, const uint16_t* pixels,
                    std::span<const Metadata> metadata) {
    assert(width > 0 && height > 0);
    OIIO::ImageSpec spec(width, height, 1, OIIO::TypeDesc::UINT16);
    spec.attribute("oiio:ColorSpace", "linear");
    add_texts(spec, metadata);
    ImageWriter writer(path, spec, "png");
    writer.write_rows(0, height, OIIO::TypeDesc::UINT16, pixels);
    writer.commit();
}

void write_grey_tiff(const std::string& path, int width, int height, const float* pixels,
                     const std::string& description) {
    assert(width > 0 && height > 0);
    OIIO::ImageSpec spec(width, height, 1, OIIO::TypeDesc::FLOAT);
    spec.attribute("compression", "none");
    spec.attribute("ImageDescription", description);
    spec.attribute("DateTime", ""); // else OpenImageIO writes the current time
    ImageWriter writer(path, spec, "tiff");
    writer.write_rows(0, height, OIIO::TypeDesc::FLOAT, pixels);
    writer.commit();
}

ImageHeader image_header(const std::string& path) {
    const QuietPng quiet(path);
    const InputFile input = open_image(path);
    const OIIO::ImageSpec spec = spec_of(*input);
    ImageHeader header{Extent::several, spec.width, spec.height, spec.nchannels};
    if (swaps_sides(orientation_of(spec))) std::swap(header.width, header.height);
    if (input->seek_subimage(1, 0)) return header;
    (void)input->geterror();
    header.extent = fills_frame(spec) ? Extent::whole : Extent::cropped;
    return header;
}

namespace {

std::string text_of(const OIIO::ParamValue& value) {
    if (value.type() == OIIO::TypeDesc::DOUBLE) return fmt::format("{}", value.get<double>());
    return value.get_string();
}

} // namespace

std::vector<std::pair<std::string, std::string>> read_all_metadata(const std::string& path) {
    const QuietPng quiet(path);
    const InputFile input = open_image(path);
    std::vector<std::pair<std::string, std::string>> all;
    for (const OIIO::ParamValue& value : input->spec().extra_attribs)
        all.emplace_back(value.name().string(), text_of(value));
    std::ranges::sort(all);
    return all;
}

namespace {

InputFile open_if_image(const std::string& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error) || !png_fault(path).empty()) return nullptr;
    std::string why;
    return open_format(path, {}, why);
}

bool is_readable_to_end(OIIO::ImageInput& input) {
    const OIIO::ImageSpec spec = input.spec();
    if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1 || spec.deep) return false;
    const int64_t row = int64_t(spec.width) * spec.nchannels;
    if (row * strip_rows * int64_t(sizeof(float)) > max_bytes) return false; // larger than any picture
    std::vector<float> strip(size_t(row) * size_t(strip_rows));
    const int end = spec.y + spec.height;
    for (int y = spec.y; y < end; y += strip_rows)
        if (!input.read_scanlines(0, 0, y, std::min(end, y + strip_rows), 0, 0, spec.nchannels,
                                  OIIO::TypeDesc::FLOAT, strip.data())) {
            (void)input.geterror();
            return false;
        }
    return true;
}

std::optional<std::string> text_of(const OIIO::ImageSpec& spec, const std::string& key) {
    const OIIO::ParamValue* value = spec.find_attribute(key);
    if (!value) return std::nullopt;
    return text_of(*value);
}

} // namespace

std::optional<std::string> read_metadata(const std::string& path, const std::string& key) {
    const QuietPng quiet(path);
    const InputFile input = open_if_image(path);
    return input ? text_of(input->spec(), key) : std::nullopt;
}

std::optional<std::string> whole_metadata(const std::string& path, const std::string& key) {
    const QuietPng quiet(path);
    const InputFile input = open_if_image(path);
    if (!input || !is_readable_to_end(*input)) return std::nullopt;
    return text_of(input->spec(), key);
}

} // namespace marram
