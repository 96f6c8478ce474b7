// SPDX-License-Identifier: Apache-2.0
#include "core/compare/page_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram::page {
namespace {

// Black, violet, orange, white: lightness increases with the value, also for colour-blind readers.
constexpr double heat_stops[][3] = {{0.0, 0.0, 0.02},   {0.23, 0.06, 0.44}, {0.55, 0.16, 0.51},
                                    {0.87, 0.29, 0.41}, {0.99, 0.6, 0.38},  {0.99, 0.99, 0.75}};

// Quantized to 64 steps: finer ones are invisible, and their noise would be half of the page's bytes.
std::array<float, 3> heat(double x) {
    const double at = std::round((x > 0.0 ? std::min(x, 1.0) : 0.0) * 63.0) / 63.0 * 5.0;
    const int i = std::min(int(at), 4);
    std::array<float, 3> rgb{};
    for (size_t c = 0; c < 3; ++c)
        rgb[c] =
            linear_from_srgb(float(heat_stops[i][c] + (at - i) * (heat_stops[i + 1][c] - heat_stops[i][c])));
    return rgb;
}

// Maximum over the channels of each pixel.
std::vector<float> brightest(const Picture::Layer& layer) {
    const size_t channels = layer.channels.size();
    std::vector<float> out(layer.pixels.size() / channels);
    for (size_t i = 0; i < layer.pixels.size(); ++i)
        out[i / channels] = std::max(out[i / channels], layer.pixels[i]);
    return out;
}

// Quantile: the value that the fraction `share` of the values does not exceed.
double quantile(std::vector<float> values, double share) {
    const auto at = values.begin() + long(std::min(double(values.size()) * share, double(values.size() - 1)));
    std::nth_element(values.begin(), at, values.end());
    return double(*at);
}

// Below this value 8-bit rounding errors exceed about a tenth.
const double dark = double(linear_from_srgb(32.0F / 255.0F));

} // namespace

Exposures exposures_of(const Picture::Layer& test, const Picture::Layer& reference, bool display) {
    Exposures out;
    const std::vector<float> a = brightest(test), b = brightest(reference);
    std::vector<float> both = a;
    both.insert(both.end(), b.begin(), b.end());
    const double greatest = double(*std::max_element(both.begin(), both.end()));
    double usual = quantile(both, 0.99);
    if (usual <= 0.0) usual = greatest;
    // As in the file if that is visible, otherwise scaled so that the 99th percentile fills the screen's
    // range.
    if (usual > 2.0 || (usual > 0.0 && usual < 0.25)) out.base = -int(std::ceil(std::log2(usual)));
    const double scale = std::exp2(out.base);
    if (greatest * scale > 1.0)
        out.highlights = -std::clamp(int(std::ceil(std::log2(greatest * scale))), 1, 8);
    const auto share_beyond = [](const std::vector<float>& values, double limit) {
        return double(std::ranges::count_if(values, [&](float v) { return double(v) > limit; })) /
               double(values.size());
    };
    out.white_test = share_beyond(a, 1.0 / scale);
    out.white_reference = share_beyond(b, 1.0 / scale);
    out.lost = out.highlights < 0 ? share_beyond(both, std::exp2(-out.highlights) / scale) : 0.0;
    // 8-bit pictures have no finer shadow detail.
    const auto dim = [&](float v) { return v > 0.0F && double(v) * scale < dark; };
    const auto count = [&](const Picture::Layer& layer) { return std::ranges::count_if(layer.pixels, dim); };
    const double dim_share =
        double(count(test) + count(reference)) / double(test.pixels.size() + reference.pixels.size());
    if (!display && dim_share > 1e-3) out.shadows = 6;
    return out;
}

Pixels exposed(const Picture::Layer& layer, const Exposures& exposures, Part part) {
    const size_t channels = layer.channels.size(), count = layer.pixels.size() / channels;
    const double base = std::exp2(exposures.base), more = part == Part::highlights ? exposures.highlights
                                                          : part == Part::shadows  ? exposures.shadows
                                                                                   : 0;
    Pixels rgb(3 * count);
    for (size_t i = 0; i < rgb.size(); ++i) {
        const double v = double(layer.pixels[i / 3 * channels + std::min(i % 3, channels - 1)]) * base;
        if ((part == Part::highlights && v <= 1.0) || (part == Part::shadows && v >= dark)) continue;
        rgb[i] = float(std::clamp(v * std::exp2(more), 0.0, 1.0));
    }
    return rgb;
}

Pixels map_linearly(const Picture::Layer& layer, const Picture::Layer& reference) {
    const auto [least, greatest] = std::ranges::minmax(reference.pixels);
    const float low = std::min(0.0F, least), high = greatest > low ? greatest : low + 1.0F;
    const size_t channels = layer.channels.size(), count = layer.pixels.size() / channels;
    Pixels rgb(3 * count);
    for (size_t i = 0; i < count; ++i)
        for (size_t c = 0; c < 3; ++c) {
            // Two channels are red and green.
            const float v = channels == 1  ? layer.pixels[i]
                            : c < channels ? layer.pixels[i * channels + c]
                                           : low;
            const double share = (double(v) - double(low)) / (double(high) - double(low));
            const auto shown = float(std::clamp(share, 0.0, 1.0));
            rgb[3 * i + c] = layer.name == "albedo" ? shown : linear_from_srgb(shown);
        }
    return rgb;
}

std::vector<float> differences(const Picture::Layer& a, const Picture::Layer& b) {
    const size_t channels = b.channels.size();
    std::vector<float> out(b.pixels.size() / channels);
    for (size_t i = 0; i < b.pixels.size(); ++i) { // the difference of the largest floats could overflow
        constexpr double largest = 3e38;
        const double apart = std::min(std::abs(double(a.pixels[i]) - double(b.pixels[i])), largest);
        out[i / channels] = std::max(out[i / channels], float(apart));
    }
    return out;
}

Pixels heat_map(const std::vector<float>& values, double white) {
    Pixels rgb;
    rgb.reserve(3 * values.size());
    for (const float v : values)
        for (const float c : heat(white > 0.0 ? double(v) / white : 0.0)) rgb.push_back(c);
    return rgb;
}

std::string heat_gradient() {
    std::string out = "linear-gradient(90deg";
    for (const auto& stop : heat_stops)
        out += fmt::format(",rgb({:.0f} {:.0f} {:.0f})", 255 * stop[0], 255 * stop[1], 255 * stop[2]);
    return out + ")";
}

double heat_white(const std::vector<float>& values) {
    const double most = double(*std::max_element(values.begin(), values.end())),
                 usual = 4.0 * quantile(values, 0.999);
    return usual > 0.0 ? std::min(most, usual) : most;
}

Pixels cut(const Pixels& rgb, int width, const Region& region) {
    Pixels out;
    for (int y = region.y; y < region.y + region.height; ++y) {
        const auto row = rgb.begin() + 3 * (long(y) * width + region.x);
        out.insert(out.end(), row, row + 3 * region.width);
    }
    return out;
}

Region worst_region(const std::vector<float>& values, int width, int height) {
    const int side = std::clamp(std::max(width, height) / 30, 8, 128), step = side / 4;
    Region worst{0, 0, std::min(side, width), std::min(side, height)};
    double most = -1.0;
    for (int y = 0;; y += step) {
        const int top = std::min(y, height - worst.height);
        for (int x = 0;; x += step) {
            const int left = std::min(x, width - worst.width);
            double sum = 0.0;
            for (int j = top; j < top + worst.height; ++j)
                for (int i = left; i < left + worst.width; ++i)
                    sum += double(values[size_t(j) * size_t(width) + size_t(i)]);
            if (sum > most) {
                most = sum;
                worst.x = left;
                worst.y = top;
            }
            if (left >= width - worst.width) break;
        }
        if (top >= height - worst.height) break;
    }
    return worst;
}

Region context_of(const Region& region, int width, int height) {
    const int side = std::max({32, width / 8, 2 * region.width, 2 * region.height});
    Region out{0, 0, std::min(side, width), std::min(side, height)};
    out.x = std::clamp(region.x + (region.width - out.width) / 2, 0, width - out.width);
    out.y = std::clamp(region.y + (region.height - out.height) / 2, 0, height - out.height);
    return out;
}

const ScaleResult* failing_square(const std::vector<ScaleResult>& scales) {
    const ScaleResult *smallest = nullptr, *nearest = nullptr;
    bool fails = false;
    for (const ScaleResult& scale : scales) {
        fails |= scale.fails();
        if (scale.size == 0) continue;
        if (scale.fails() && (!smallest || scale.size < smallest->size)) smallest = &scale;
        if (!nearest || scale.worst / scale.limit > nearest->worst / nearest->limit) nearest = &scale;
    }
    return smallest ? smallest : fails ? nearest : nullptr;
}

std::string channel_of(const ScaleResult& scale, const Picture& picture) {
    static constexpr const char* names[] = {"red", "green", "blue"};
    return scale.worst == 0.0 ? "" : picture.grey ? "grey" : names[std::clamp(scale.channel, 0, 2)];
}

Region region_of(const ScaleResult& square, int width, int height) {
    return {square.x, square.y, std::min(square.size, width - square.x),
            std::min(square.size, height - square.y)};
}

} // namespace marram::page
