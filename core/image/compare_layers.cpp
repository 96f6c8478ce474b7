// SPDX-License-Identifier: Apache-2.0
#include "core/image/compare_layers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

namespace marram {
namespace {

// Limits: core/image/compare.h says what they are.
constexpr double layer_share = 0.03;                      // of a layer's range, mean difference
constexpr double layer_bias = 0.01, layer_beyond = 0.015; // or these two
constexpr double names_share = 0.9;
constexpr int farthest = 2;    // pixels by which a layer may turn out to be moved
constexpr double chance = 4.0; // standard deviations of what is counted or correlated

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

// The share of names (0 is none) that are none of those around their place in the other picture.
double share_unknown(const Picture::Layer& a, const Picture::Layer& b, Frame frame) {
    double unknown = 0.0, named = 0.0;
    const auto add = [&](float name, std::span<const float> around) {
        if (name == 0.0F) return;
        named += 1.0;
        unknown += std::ranges::find(around, name) == around.end();
    };
    each_with_around(a, b, frame, add);
    each_with_around(b, a, frame, add);
    return named > 0.0 ? unknown / named : 0.0;
}

// "id", "object_id", "objectID", but not "fluid".
bool is_called_id(const std::string& name) {
    const size_t n = name.size();
    if (n < 2 || std::tolower(name[n - 2]) != 'i' || std::tolower(name[n - 1]) != 'd') return false;
    return n == 2 || !std::isalpha(static_cast<unsigned char>(name[n - 3])) ||
           (name[n - 2] == 'I' && std::islower(static_cast<unsigned char>(name[n - 3])));
}

bool holds_names(const Picture::Layer& layer) {
    return layer.channels.size() == 1 && is_called_id(layer.name) &&
           std::ranges::all_of(layer.pixels, [](float v) { return v == std::floor(v); });
}

struct Offset {
    int x = 0, y = 0;
};

// Calls see(i, j) for the numbers of a layer, and of the other moved by the offset, that lie upon each other.
void each_pair(size_t channels, Frame frame, Offset by, auto&& see) {
    for (int y = std::max(0, by.y); y < frame.height + std::min(0, by.y); ++y)
        for (int x = std::max(0, by.x); x < frame.width + std::min(0, by.x); ++x)
            for (size_t c = 0; c < channels; ++c)
                see((size_t(y) * size_t(frame.width) + size_t(x)) * channels + c,
                    (size_t(y - by.y) * size_t(frame.width) + size_t(x - by.x)) * channels + c);
}

// Pearson's, of all channels together.
double correlation(const Picture::Layer& a, const Picture::Layer& b, Frame frame, Offset by) {
    const size_t channels = a.channels.size();
    struct Sums {
        double n = 0.0, a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
    };
    std::vector<Sums> sums(channels);
    each_pair(channels, frame, by, [&](size_t i, size_t j) {
        Sums& s = sums[i % channels];
        const auto u = double(a.pixels[i]), v = double(b.pixels[j]);
        s.n += 1.0, s.a += u, s.b += v, s.aa += u * u, s.bb += v * v, s.ab += u * v;
    });
    double ab = 0.0, aa = 0.0, bb = 0.0;
    for (const Sums& s : sums) {
        if (s.n == 0.0) continue;
        ab += s.ab - s.a * s.b / s.n;
        aa += s.aa - s.a * s.a / s.n;
        bb += s.bb - s.b * s.b / s.n;
    }
    return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
}

// The share of pixels that hold the same name, of those that hold one in either.
double share_same(const Picture::Layer& a, const Picture::Layer& b, Frame frame, Offset by) {
    double same = 0.0, named = 0.0;
    each_pair(1, frame, by, [&](size_t i, size_t j) {
        if (a.pixels[i] == 0.0F && b.pixels[j] == 0.0F) return;
        named += 1.0;
        same += a.pixels[i] == b.pixels[j];
    });
    return named > 0.0 ? same / named : 0.0;
}

// Where a layer fits the other better than in its place, by more than chance makes of so many pixels. fit: of an offset, at most 1.
std::optional<Offset> moved_by(Frame frame, auto&& fit) {
    const double in_place = fit(Offset{}), spare = chance / std::sqrt(double(frame.width) * frame.height);
    double best = in_place + spare;
    std::optional<Offset> found;
    for (int y = -farthest; y <= farthest; ++y)
        for (int x = -farthest; x <= farthest; ++x)
            if (const double there = fit(Offset{x, y}); there > best) {
                best = there;
                found = Offset{x, y};
            }
    return found;
}

std::string moved_fault(const std::string& name, Offset by) {
    return fmt::format("layer {} fits the other better when that is moved by {} pixels across and {} down",
                       name, by.x, by.y);
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
        if (share > names_share)
            return fmt::format("layer {} is of other names: {:.3g} of its pixels with one hold one that the "
                               "other picture has nowhere near, {} are allowed",
                               b.name, share, names_share);
        const auto by = moved_by(frame, [&](Offset offset) { return share_same(a, b, frame, offset); });
        return by ? moved_fault(b.name, *by) : "";
    }
    if (result.mean <= layer_share * result.range) return "";
    if (bias_of(a, b) <= layer_bias * result.range &&
        mean_beyond(a, b, frame) <= layer_beyond * result.range) {
        const auto by = moved_by(frame, [&](Offset offset) { return correlation(a, b, frame, offset); });
        return by ? moved_fault(b.name, *by) : "";
    }
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
