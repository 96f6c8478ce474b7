// SPDX-License-Identifier: Apache-2.0
#include "core/image/data_image.h"

#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>

namespace marram {
namespace {

// ---- the tag --------------------------------------------------------------------------------------------------------

// Little- or big-endian numbers of a TIFF file (TIFF 6.0, section 2; BigTIFF has wider offsets).
class TiffNumbers {
  public:
    explicit TiffNumbers(const std::string& path) : file_(path, std::ios::binary) {
        std::array<char, 2> order{};
        file_.read(order.data(), order.size());
        is_tiff_ = file_ && order[0] == order[1] && (order[0] == 'I' || order[0] == 'M');
        big_endian_ = order[0] == 'M';
    }
    bool is_tiff() const { return is_tiff_; }
    bool fails() const { return !file_; }
    void seek(uint64_t at) { file_.seekg(std::streamoff(std::min<uint64_t>(at, INT64_MAX))); }
    uint64_t number(int bytes) {
        std::array<unsigned char, 8> b{};
        file_.read(reinterpret_cast<char*>(b.data()), bytes);
        uint64_t value = 0;
        for (int i = 0; i < bytes; ++i)
            value |= uint64_t(b[size_t(i)]) << (8 * (big_endian_ ? bytes - 1 - i : i));
        return value;
    }
    std::string text(size_t bytes) {
        std::string text(bytes, '\0');
        file_.read(text.data(), std::streamsize(bytes));
        return text.substr(0, text.find('\0'));
    }

  private:
    std::ifstream file_;
    bool is_tiff_ = false, big_endian_ = false;
};

constexpr uint64_t nodata_tag = 42113, ascii_type = 2;
constexpr uint64_t max_nodata_text = 256, max_tags = 4096; // more: damaged

std::string nodata_text(const std::string& path) {
    TiffNumbers file(path);
    if (!file.is_tiff()) return "";
    const uint64_t version = file.number(2);
    if (version != 42 && version != 43) return "";
    const bool big = version == 43;
    if (big) file.number(4); // the width of offsets, always 8, and 0
    file.seek(file.number(big ? 8 : 4));
    const uint64_t tags = file.number(big ? 8 : 2);
    if (file.fails() || tags > max_tags) return "";
    for (uint64_t i = 0; i < tags; ++i) {
        const uint64_t tag = file.number(2), type = file.number(2), count = file.number(big ? 8 : 4);
        if (tag == nodata_tag && type == ascii_type && !file.fails() && count <= max_nodata_text) {
            // A text that fits stands in place of its offset.
            if (count > (big ? 8U : 4U)) file.seek(file.number(big ? 8 : 4));
            return file.text(size_t(count));
        }
        file.number(big ? 8 : 4);
    }
    return "";
}

// ---- holes ----------------------------------------------------------------------------------------------------------

// Whether a pixel has the declared value: texts of floats are often rounded. A value that is the largest
// float or beyond, as in files of doubles, is infinite as a float, or clamped to the largest.
bool is_value(double pixel, double value) {
    constexpr double rounded = 1e-6, largest = 3.4028e38;
    if (std::isnan(value)) return std::isnan(pixel);
    if (std::abs(value) >= largest)
        return std::abs(pixel) >= largest && std::signbit(pixel) == std::signbit(value);
    return pixel == value || std::abs(pixel - value) <= rounded * std::abs(value);
}

struct Marked {
    std::vector<char> pixels;
    size_t count = 0, first = 0;
};

// Pixels of which a channel has the value.
Marked pixels_with(const Image& image, double value) {
    Marked marked;
    const auto channels = size_t(image.channels);
    marked.pixels.assign(image.pixels.size() / channels, 0);
    for (size_t p = marked.pixels.size(); p-- > 0;)
        for (size_t c = 0; c < channels && !marked.pixels[p]; ++c)
            if (is_value(double(image.pixels[p * channels + c]), value)) {
                marked.pixels[p] = 1;
                ++marked.count;
                marked.first = p;
            }
    return marked;
}

std::string pixels_text(const Image& image, const Marked& marked) {
    return fmt::format("{} of {} pixels, the first at ({}, {}),", marked.count, marked.pixels.size(),
                       marked.first % size_t(image.width), marked.first / size_t(image.width));
}

// ---- values that stand alone ----------------------------------------------------------------------------------------

// A value of the first channel, as stored, that several or single pixels have and that is far from all
// others.
struct Outlier {
    double value, low, high; // low, high: of the others
};

// Only great numbers, as markers are: a mask of 0 and 1 has none.
std::optional<Outlier> outlier_of(const Image& image) {
    constexpr double min_marker = 999.0; // the smallest in use
    constexpr double far = 3.0;          // ranges of the other values
    const auto channels = size_t(image.channels);
    constexpr double infinity = std::numeric_limits<double>::infinity();
    double low = infinity, high = -infinity;
    for (size_t i = 0; i < image.pixels.size(); i += channels) {
        low = std::min(low, double(image.pixels[i]));
        high = std::max(high, double(image.pixels[i]));
    }
    for (const double extreme : {low, high}) {
        if (!(std::abs(extreme * image.stored_one) >= min_marker)) continue;
        double others_low = infinity, others_high = -infinity;
        for (size_t i = 0; i < image.pixels.size(); i += channels)
            if (const auto v = double(image.pixels[i]); v != extreme) {
                others_low = std::min(others_low, v);
                others_high = std::max(others_high, v);
            }
        const double gap = extreme == low ? others_low - extreme : extreme - others_high;
        if (others_low < others_high && gap > far * (others_high - others_low))
            return Outlier{extreme, others_low, others_high};
    }
    return std::nullopt;
}

void note_outlier(const Image& image, std::vector<std::string>& notes) {
    // Unsigned integers: their largest is white.
    if (!image.stored_signed) return;
    const std::optional<Outlier> outlier = outlier_of(image);
    if (!outlier) return;
    const auto stored = [&](double v) { return v * image.stored_one; };
    notes.push_back(
        fmt::format("{} are {:.6g}, far from all others, which are {:.6g} to {:.6g}: if they are holes, "
                    "declare that value in a TIFF (gdal_edit.py -a_nodata), else ignore this",
                    pixels_text(image, pixels_with(image, outlier->value)), stored(outlier->value),
                    stored(outlier->low), stored(outlier->high)));
}

// ---- filling --------------------------------------------------------------------------------------------------------

// One channel, with the weight of what is known: 0 where nothing is.
struct Level {
    int width = 0, height = 0;
    std::vector<double> values, weights;
    size_t at(int x, int y) const { return size_t(y) * size_t(width) + size_t(x); }
};

// Means of the known values of 2 x 2.
Level halved(const Level& fine) {
    Level coarse{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
    coarse.values.assign(size_t(coarse.width) * size_t(coarse.height), 0.0);
    coarse.weights = coarse.values;
    for (int y = 0; y < fine.height; ++y)
        for (int x = 0; x < fine.width; ++x) {
            const size_t from = fine.at(x, y), to = coarse.at(x / 2, y / 2);
            coarse.values[to] += fine.weights[from] * fine.values[from];
            coarse.weights[to] += fine.weights[from];
        }
    for (size_t i = 0; i < coarse.values.size(); ++i)
        if (coarse.weights[i] > 0.0) {
            coarse.values[i] /= coarse.weights[i];
            coarse.weights[i] = 1.0;
        }
    return coarse;
}

// Fills the unknown values of a level from the next coarser one, bilinearly.
void fill_level(Level& fine, const Level& coarse) {
    for (int y = 0; y < fine.height; ++y)
        for (int x = 0; x < fine.width; ++x) {
            double& value = fine.values[fine.at(x, y)];
            if (fine.weights[fine.at(x, y)] > 0.0) continue;
            const double u = std::clamp(0.5 * x - 0.25, 0.0, double(coarse.width - 1)),
                         v = std::clamp(0.5 * y - 0.25, 0.0, double(coarse.height - 1));
            const int i = int(u), j = int(v), i1 = std::min(i + 1, coarse.width - 1),
                      j1 = std::min(j + 1, coarse.height - 1);
            const double s = u - i, t = v - j;
            value =
                (1 - t) * ((1 - s) * coarse.values[coarse.at(i, j)] + s * coarse.values[coarse.at(i1, j)]) +
                t * ((1 - s) * coarse.values[coarse.at(i, j1)] + s * coarse.values[coarse.at(i1, j1)]);
        }
}

void relax(Level& level, const std::vector<size_t>& unknown) {
    constexpr int sweeps = 32;
    for (int sweep = 0; sweep < sweeps; ++sweep)
        for (const size_t p : unknown) {
            const int x = int(p % size_t(level.width)), y = int(p / size_t(level.width));
            double sum = 0.0, count = 0.0;
            for (const auto& [i, j] : {std::pair(x - 1, y), {x + 1, y}, {x, y - 1}, {x, y + 1}})
                if (i >= 0 && i < level.width && j >= 0 && j < level.height) {
                    sum += level.values[level.at(i, j)];
                    count += 1.0;
                }
            if (count > 0.0) level.values[p] = sum / count;
        }
}

} // namespace

std::optional<double> declared_nodata(const std::string& path) {
    std::string text = nodata_text(path);
    const size_t begin = text.find_first_not_of(" +\t\n"), end = text.find_last_not_of(" \t\n");
    if (begin == std::string::npos) return std::nullopt;
    double value = 0.0;
    const char *first = text.data() + begin, *last = text.data() + end + 1;
    const auto [stop, error] = std::from_chars(first, last, value);
    if (stop != last) return std::nullopt;
    if (error == std::errc()) return value;
    // The largest double with 15 digits is rounded up, beyond a double.
    constexpr double largest = std::numeric_limits<double>::max();
    if (text.find("e-") != std::string::npos || text.find("E-") != std::string::npos) return std::nullopt;
    return *first == '-' ? -largest : largest;
}

void fill_pixels(Image& image, const std::vector<char>& marked) {
    std::vector<size_t> unknown;
    for (size_t p = 0; p < marked.size(); ++p)
        if (marked[p]) unknown.push_back(p);
    if (unknown.size() == marked.size()) return;
    const auto channels = size_t(image.channels);
    for (size_t c = 0; c < channels; ++c) {
        std::vector<Level> levels(1);
        Level& finest = levels[0];
        finest.width = image.width;
        finest.height = image.height;
        for (size_t p = 0; p < marked.size(); ++p) {
            finest.values.push_back(marked[p] ? 0.0 : double(image.pixels[p * channels + c]));
            finest.weights.push_back(marked[p] ? 0.0 : 1.0);
        }
        while (std::ranges::find(levels.back().weights, 0.0) != levels.back().weights.end())
            levels.push_back(halved(levels.back()));
        for (size_t l = levels.size() - 1; l-- > 0;) fill_level(levels[l], levels[l + 1]);
        relax(levels[0], unknown);
        for (const size_t p : unknown) image.pixels[p * channels + c] = float(levels[0].values[p]);
    }
}

Image read_data_image(const std::string& path, std::vector<std::string>& notes) {
    Image image = read_image(path, ColorSpace::raw_data);
    if (const std::optional<double> nodata = declared_nodata(path)) {
        const double read = image.stored_one > 1.0 ? *nodata / image.stored_one : *nodata;
        const bool fits = std::abs(read) <= double(std::numeric_limits<float>::max());
        Marked holes = pixels_with(image, fits ? double(float(read)) : read);
        // OpenImageIO may read the least signed integer as -1.
        if (holes.count == 0 && image.stored_one > 1.0 && read < -1.0) holes = pixels_with(image, -1.0);
        if (holes.count == holes.pixels.size())
            throw InputError({path},
                             fmt::format("has no data: all pixels are {:.6g}, its value for holes", *nodata),
                             "export it again");
        if (holes.count > 0) {
            fill_pixels(image, holes.pixels);
            notes.push_back(
                fmt::format("{} are holes (the file declares {:.6g} as no data): filled from around",
                            pixels_text(image, holes), *nodata));
        }
    }
    check_finite(path, image);
    note_outlier(image, notes);
    return image;
}

} // namespace marram
