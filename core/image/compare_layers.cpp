// SPDX-License-Identifier: Apache-2.0
#include "core/image/compare_layers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

namespace marram {
namespace {

// Limits: core/image/compare.h says what they are.
constexpr double layer_share = 0.03;                      // of a layer's range, mean difference
constexpr double layer_bias = 0.01, layer_beyond = 0.015; // or these two
constexpr double names_share = 0.6;

struct Frame {
    int width, height;
};

// Calls see(value, around) for each number of a layer and those of the 3 x 3 pixels around its place in the other.
void each_with_around(const Picture::Layer& mine, const Picture::Layer& other, Frame frame, auto&& see) {
    const size_t channels = mine.channels.size();
    std::array<float, 9> around;
    for (int y = 0; y < frame.height; ++y)
        for (int x = 0; x < frame.width; ++x)
            for (size_t c = 0; c < channels; ++c) {
                const auto at = [&](int i, int j) {
                    return (size_t(j) * size_t(frame.width) + size_t(i)) * channels + c;
                };
                size_t count = 0;
                for (int j = std::max(y - 1, 0); j <= std::min(y + 1, frame.height - 1); ++j)
                    for (int i = std::max(x - 1, 0); i <= std::min(x + 1, frame.width - 1); ++i)
                        around[count++] = other.pixels[at(i, j)];
                see(mine.pixels[at(x, y)], std::span(around.data(), count));
            }
}

// By how much numbers are less or greater than all those around their place in the other picture: the mean of both pictures.
double mean_beyond(const Picture::Layer& a, const Picture::Layer& b, Frame frame) {
    double sum = 0.0;
    const auto add = [&](float value, std::span<const float> around) {
        const auto [low, high] = std::ranges::minmax(around);
        sum += std::max({0.0, double(value) - double(high), double(low) - double(value)});
    };
    each_with_around(a, b, frame, add);
    each_with_around(b, a, frame, add);
    return sum / (2.0 * double(a.pixels.size()));
}

// The share of names that are none of those around their place in the other picture.
double share_unknown(const Picture::Layer& a, const Picture::Layer& b, Frame frame) {
    double unknown = 0.0;
    const auto add = [&](float name, std::span<const float> around) {
        unknown += std::ranges::find(around, name) == around.end();
    };
    each_with_around(a, b, frame, add);
    each_with_around(b, a, frame, add);
    return unknown / (2.0 * double(a.pixels.size()));
}

bool holds_names(const Picture::Layer& layer) {
    bool many = false; // 0 and 1 alone are a mask
    for (const float v : layer.pixels) {
        if (v != std::floor(v)) return false;
        many |= v != 0.0F && v != 1.0F;
    }
    return many && layer.channels.size() == 1;
}

// The greatest difference of a channel's means.
double bias_of(const Picture::Layer& a, const Picture::Layer& b) {
    std::vector<double> sums(b.channels.size());
    for (size_t i = 0; i < b.pixels.size(); ++i)
        sums[i % sums.size()] += double(a.pixels[i]) - double(b.pixels[i]);
    double most = 0.0;
    for (const double sum : sums)
        most = std::max(most, std::abs(sum) * double(sums.size()) / double(b.pixels.size()));
    return most;
}

std::string fault_of(const Picture::Layer& a, const Picture::Layer& b, const LayerResult& result,
                     Frame frame) {
    if (b.name.empty()) return "";
    if (holds_names(a) && holds_names(b)) {
        const double share = share_unknown(a, b, frame);
        if (share <= names_share) return "";
        return fmt::format("layer {} is of other names: {:.3g} of its pixels hold one that the other picture "
                           "has nowhere near, {} are "
                           "allowed",
                           b.name, share, names_share);
    }
    if (result.mean <= layer_share * result.range) return "";
    if (bias_of(a, b) <= layer_bias * result.range && mean_beyond(a, b, frame) <= layer_beyond * result.range)
        return "";
    return fmt::format(
        "layer {} differs by {:.3g} in the mean, {:.3g} is allowed (three hundredths of its range)", b.name,
        result.mean, layer_share * result.range);
}

} // namespace

LayerResult compare_layer(const Picture::Layer& a, const Picture::Layer& b, int width, int height) {
    LayerResult result;
    result.name = b.name;
    result.channels = int(b.channels.size());
    double squares = 0.0, sum = 0.0, mean = 0.0, low = 0.0, high = b.name.empty() ? 1.0 : 0.0;
    for (const float v : b.pixels) {
        low = std::min(low, double(v));
        high = std::max(high, double(v));
        mean += std::abs(double(v)) / double(b.pixels.size());
    }
    const double least = 0.01 * mean * mean + 1e-30; // so that black pixels do not count without bound
    double relative = 0.0;
    for (size_t i = 0; i < b.pixels.size(); ++i) {
        const double d = double(a.pixels[i]) - double(b.pixels[i]);
        squares += d * d;
        sum += std::abs(d);
        relative += d * d / (double(b.pixels[i]) * double(b.pixels[i]) + least);
        result.most = std::max(result.most, std::abs(d));
    }
    const auto count = double(b.pixels.size());
    result.range = high - low;
    if (!b.name.empty()) { // of the middle 98 in 100: one stray number is no range
        std::vector<float> sorted = b.pixels;
        std::ranges::sort(sorted);
        const double middle = double(sorted[sorted.size() * 99 / 100]) - double(sorted[sorted.size() / 100]);
        const double usual = std::max(middle, std::abs(double(sorted[sorted.size() / 2])));
        if (usual > 0.0) result.range = usual;
    }
    result.rmse = std::sqrt(squares / count);
    result.relative_mse = relative / count;
    result.mean = sum / count;
    result.psnr = result.rmse > 0.0 ? 20.0 * std::log10(result.range / result.rmse)
                                    : std::numeric_limits<double>::infinity();
    result.fault = fault_of(a, b, result, {width, height});
    return result;
}

} // namespace marram
