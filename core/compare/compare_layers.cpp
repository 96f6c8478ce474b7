// SPDX-License-Identifier: Apache-2.0
#include "core/compare/compare_layers.h"

#include "core/compare/windows.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <string_view>

namespace marram {
namespace {

// Limits, described in core/compare/compare.h.
constexpr double layer_share = 0.03;   // mean difference, relative to the layer's range
constexpr double layer_bias = 0.01;    // difference of a channel's means, likewise
constexpr double layer_excess = 0.015; // mean excess, likewise
// Mean excess in a window, minus noise_excess times the excess over the neighbours in the own picture.
constexpr double window_excess = 0.03;
constexpr double noise_excess = 1.25;
constexpr double window_bias = 0.1;   // difference of a window's means, relative to the layer's range
constexpr double window_level = 1e-3; // probability of a false alarm of these, over all windows and channels
constexpr double plain_share = 0.5;   // of the layer's range: a difference that no noise may hide
constexpr double plain_alpha = 0.1;   // the same of alpha, absolute: people see it in the picture
constexpr double noise_names = 1.1, spare_names = 0.05; // limit for unknown ids: factor on noise, offset
constexpr double window_names = 0.1;                    // fraction of a window's pixels
constexpr int farthest = 2;                             // maximum tested shift, pixels
constexpr double chance = 4.0;                          // limit in standard deviations

// Layers whose values are means over all samples. Others are means over the samples that hit, and 0 where
// none hits, so that their windows' means depend on the number of samples.
constexpr std::array<std::string_view, 3> means_over_all = {"alpha", "albedo", "normal"};

struct Frame {
    int width, height;
};

// Neighbourhood to compare with: the 3 x 3 pixels in the other picture, or the 8 neighbours in the same
// picture.
enum class Around { there, here };

// Calls see(pixel, value, around) for each value of a channel, with the values of its neighbourhood.
void each_with_around(const Picture::Layer& mine, const Picture::Layer& other, size_t channel, Frame frame,
                      Around where, auto&& see) {
    const size_t channels = mine.channels.size();
    std::array<float, 9> around;
    for (int y = 0; y < frame.height; ++y)
        for (int x = 0; x < frame.width; ++x) {
            const auto pixel = [&](int i, int j) { return size_t(j) * size_t(frame.width) + size_t(i); };
            size_t count = 0;
            for (int j = std::max(y - 1, 0); j <= std::min(y + 1, frame.height - 1); ++j)
                for (int i = std::max(x - 1, 0); i <= std::min(x + 1, frame.width - 1); ++i)
                    if (where == Around::there || i != x || j != y)
                        around[count++] = other.pixels[pixel(i, j) * channels + channel];
            if (count > 0)
                see(pixel(x, y), mine.pixels[pixel(x, y) * channels + channel],
                    std::span(around.data(), count));
        }
}

// Excess of each value of a channel: its distance from the range of its neighbourhood.
std::vector<float> beyond(const Picture::Layer& mine, const Picture::Layer& other, size_t channel,
                          Frame frame, Around where) {
    std::vector<float> plane(size_t(frame.width) * size_t(frame.height), 0.0F);
    each_with_around(mine, other, channel, frame, where,
                     [&](size_t pixel, float value, std::span<const float> around) {
                         const auto [low, high] = std::ranges::minmax(around);
                         plane[pixel] = std::max({0.0F, value - high, low - value});
                     });
    return plane;
}

// Excess of a layer over the other picture, averaged over both directions.
struct Excess {
    double mean = 0.0;       // over the picture
    WorstWindow unexplained; // worst mean excess, minus noise
    size_t channel = 0;      // of that window
};

Excess excess_of(const Picture::Layer& a, const Picture::Layer& b, Frame frame) {
    Excess result;
    const size_t channels = b.channels.size();
    for (size_t c = 0; c < channels; ++c) {
        std::vector<float> plane = beyond(a, b, c, frame, Around::there);
        const std::vector<float> back = beyond(b, a, c, frame, Around::there),
                                 in_a = beyond(a, a, c, frame, Around::here),
                                 in_b = beyond(b, b, c, frame, Around::here);
        for (size_t i = 0; i < plane.size(); ++i) {
            const double both = 0.5 * (double(plane[i]) + double(back[i]));
            result.mean += both / double(b.pixels.size());
            plane[i] = float(both - noise_excess * 0.5 * (double(in_a[i]) + double(in_b[i])));
        }
        const WorstWindow worst = worst_window(plane, frame.width, frame.height);
        if (c == 0 || worst.mean > result.unexplained.mean) {
            result.unexplained = worst;
            result.channel = c;
        }
    }
    return result;
}

// 1 for each id that does not occur in its neighbourhood, else 0; id 0 means none.
std::vector<float> unknown(const Picture::Layer& mine, const Picture::Layer& other, Frame frame,
                           Around where) {
    std::vector<float> plane(mine.pixels.size(), 0.0F);
    each_with_around(mine, other, 0, frame, where,
                     [&](size_t pixel, float name, std::span<const float> around) {
                         const bool known = name == 0.0F || std::ranges::find(around, name) != around.end();
                         plane[pixel] = known ? 0.0F : 1.0F;
                     });
    return plane;
}

// Fraction of ids that do not occur in their neighbourhood in the other picture.
struct Unknown {
    // share: of all ids in both pictures. noise: fraction unknown among their own neighbours, in the picture
    // where it is lower.
    double share = 0.0, noise = 0.0;
    WorstWindow unexplained; // fraction of a window's pixels, minus noise
};

Unknown unknown_of(const Picture::Layer& a, const Picture::Layer& b, Frame frame) {
    std::vector<float> there = unknown(a, b, frame, Around::there);
    const std::vector<float> back = unknown(b, a, frame, Around::there),
                             in_a = unknown(a, a, frame, Around::here),
                             in_b = unknown(b, b, frame, Around::here);
    const auto sum = [](const std::vector<float>& plane) {
        return std::accumulate(plane.begin(), plane.end(), 0.0);
    };
    const auto names = [](const Picture::Layer& layer) {
        return std::max(1.0, double(layer.pixels.size()) - double(std::ranges::count(layer.pixels, 0.0F)));
    };
    Unknown result;
    result.share = (sum(there) + sum(back)) / (names(a) + names(b));
    result.noise = std::min(sum(in_a) / names(a), sum(in_b) / names(b));
    for (size_t i = 0; i < there.size(); ++i)
        there[i] = 0.5F * (there[i] + back[i] - float(noise_names) * (in_a[i] + in_b[i]));
    result.unexplained = worst_window(there, frame.width, frame.height);
    return result;
}

// Matches "id", "object_id", "objectID", but not "fluid".
bool is_called_id(const std::string& name) {
    const size_t n = name.size();
    if (n < 2 || std::tolower(name[n - 2]) != 'i' || std::tolower(name[n - 1]) != 'd') return false;
    return n == 2 || !std::isalpha(static_cast<unsigned char>(name[n - 3])) ||
           (name[n - 2] == 'I' && std::islower(static_cast<unsigned char>(name[n - 3])));
}

bool holds_ids(const Picture::Layer& layer) {
    return layer.channels.size() == 1 && is_called_id(layer.name) &&
           std::ranges::all_of(layer.pixels, [](float v) { return v == std::floor(v); });
}

struct Offset {
    int x = 0, y = 0;
};

// Calls see(i, j) for all overlapping values i of a layer and j of the other layer shifted by the offset.
void each_pair(size_t channels, Frame frame, Offset by, auto&& see) {
    for (int y = std::max(0, by.y); y < frame.height + std::min(0, by.y); ++y)
        for (int x = std::max(0, by.x); x < frame.width + std::min(0, by.x); ++x)
            for (size_t c = 0; c < channels; ++c)
                see((size_t(y) * size_t(frame.width) + size_t(x)) * channels + c,
                    (size_t(y - by.y) * size_t(frame.width) + size_t(x - by.x)) * channels + c);
}

// Pearson correlation, over all channels together.
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

// Fraction of pixels with equal ids, among those with an id in either layer.
double same_id_fraction(const Picture::Layer& a, const Picture::Layer& b, Frame frame, Offset by) {
    double same = 0.0, named = 0.0;
    each_pair(1, frame, by, [&](size_t i, size_t j) {
        if (a.pixels[i] == 0.0F && b.pixels[j] == 0.0F) return;
        named += 1.0;
        same += a.pixels[i] == b.pixels[j];
    });
    return named > 0.0 ? same / named : 0.0;
}

// The shift at which a layer matches the other significantly better than without shift, given the number of
// pixels. fit: score of an offset, at most 1.
std::optional<Offset> best_shift(Frame frame, auto&& fit) {
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
    return fmt::format("layer {} is shifted: it matches the other picture better if that is moved by {} "
                       "pixels in x and {} in y",
                       name, by.x, by.y);
}

// Difference of the means of a channel, and its limit.
struct Bias {
    double off = 0.0, allowed = 0.0;
    size_t channel = 0;
};

// The channel with the greatest difference relative to its limit.
Bias bias_of(const Picture::Layer& a, const Picture::Layer& b, double range) {
    const size_t channels = b.channels.size();
    const double count = double(b.pixels.size() / channels);
    Bias worst;
    for (size_t c = 0; c < channels; ++c) {
        double sum = 0.0, squares = 0.0;
        for (size_t i = c; i < b.pixels.size(); i += channels) {
            const double d = double(a.pixels[i]) - double(b.pixels[i]);
            sum += d;
            squares += d * d;
        }
        const double mean = sum / count,
                     error = std::sqrt(std::max(0.0, squares / count - mean * mean) / count);
        const Bias bias{std::abs(mean), std::max(layer_bias * range, chance * error), c};
        if (c == 0 || bias.off * worst.allowed > worst.off * bias.allowed) worst = bias;
    }
    return worst;
}

// Difference of the means of a channel over a window, and its limit.
struct WindowBias {
    Bias bias;
    int x = 0, y = 0; // first pixel
};

struct WindowBiases {
    WindowBias worst;        // relative to its limit
    double found_from = 0.0; // median of the limits
    bool fails() const { return worst.bias.off > worst.bias.allowed; }
};

// Differences of single pixels tell the noise of their mean over a window: those of two seeds are
// independent, and as often above zero as below.
WindowBiases window_biases(const Picture::Layer& a, const Picture::Layer& b, double range, Frame frame) {
    const size_t channels = b.channels.size();
    const std::vector<int> columns = window_starts(frame.width, local_window, local_step),
                           rows = window_starts(frame.height, local_window, local_step);
    const int w = std::min(local_window, frame.width), h = std::min(local_window, frame.height);
    const double count = double(w) * h,
                 spread = student_limit(window_level / double(columns.size() * rows.size() * channels),
                                        std::max(4.0, count - 1.0));
    WindowBiases result;
    std::vector<double> limits;
    for (size_t c = 0; c < channels; ++c)
        for (const int y : rows)
            for (const int x : columns) {
                double sum = 0.0, squares = 0.0;
                for (int j = y; j < y + h; ++j)
                    for (int i = x; i < x + w; ++i) {
                        const size_t at = (size_t(j) * size_t(frame.width) + size_t(i)) * channels + c;
                        const double d = double(a.pixels[at]) - double(b.pixels[at]);
                        sum += d;
                        squares += d * d;
                    }
                const double mean = sum / count,
                             error = std::sqrt(std::max(0.0, squares / count - mean * mean) /
                                               std::max(1.0, count - 1.0));
                const Bias bias{std::abs(mean), std::max(window_bias * range, spread * error), c};
                limits.push_back(bias.allowed);
                const Bias& worst = result.worst.bias;
                if (limits.size() == 1 || bias.off * worst.allowed > worst.off * bias.allowed)
                    result.worst = {bias, x, y};
            }
    const auto middle = limits.begin() + std::ptrdiff_t(limits.size() / 2);
    std::ranges::nth_element(limits, middle);
    result.found_from = *middle;
    return result;
}

std::string fault_of_ids(const Picture::Layer& a, const Picture::Layer& b, const Unknown& unknown,
                         double halfway, Frame frame) {
    const double allowed = std::min(halfway, noise_names * unknown.noise + spare_names);
    if (unknown.share > allowed)
        return fmt::format("layer {} has different ids: in {:.3g} of the pixels with an id the other picture "
                           "has no such id nearby, the limit is {:.3g}",
                           b.name, unknown.share, allowed);
    const WorstWindow& worst = unknown.unexplained;
    if (worst.mean > window_names)
        return fmt::format("layer {} has different ids: in {} at ({}, {}) the fraction of ids that the other "
                           "picture does not have nearby exceeds noise by {:.3g}, the limit is {:.3g}",
                           b.name, window_text(frame.width, frame.height), worst.x, worst.y, worst.mean,
                           window_names);
    const auto by = best_shift(frame, [&](Offset offset) { return same_id_fraction(a, b, frame, offset); });
    return by ? moved_fault(b.name, *by) : "";
}

// Whether noise is as great as the difference of other ids: then none are found.
std::string doubt_of_ids(const Picture::Layer& b, const Unknown& unknown, double halfway) {
    const double ids = double(b.pixels.size()) - double(std::ranges::count(b.pixels, 0.0F));
    if (halfway - unknown.noise >
        chance * std::sqrt(unknown.noise * (1.0 - unknown.noise) / std::max(1.0, ids)))
        return "";
    return fmt::format("layer {} could have other ids everywhere: in {:.3g} of the pixels with an id no "
                       "neighbour has it, also within one picture: render both larger",
                       b.name, unknown.noise);
}

void judge_ids(const Picture::Layer& a, const Picture::Layer& b, Frame frame, LayerResult& result) {
    const Unknown unknown = unknown_of(a, b, frame);
    const double halfway = 0.5 * (1.0 + unknown.noise); // between noise and 1, the value for different ids
    result.fault = fault_of_ids(a, b, unknown, halfway, frame);
    result.doubt = doubt_of_ids(b, unknown, halfway);
}

std::string fault_of(const Picture::Layer& a, const Picture::Layer& b, const LayerResult& result,
                     const std::optional<WindowBiases>& windows, Frame frame) {
    const auto channel = [&](size_t c) {
        return b.channels.size() > 1 ? b.name + "." + b.channels[c] : b.name;
    };
    const Bias bias = bias_of(a, b, result.range);
    if (bias.off > bias.allowed)
        return fmt::format("layer {}: the means differ by {:.3g}, the limit is {:.3g}", channel(bias.channel),
                           bias.off, bias.allowed);
    const Excess beyond = excess_of(a, b, frame);
    const WorstWindow& worst = beyond.unexplained;
    if (worst.mean > window_excess * result.range)
        return fmt::format("layer {} differs locally: {} at ({}, {}) lie outside the range of nearby values "
                           "of the other picture by a mean of {:.3g} more than noise, the limit is {:.3g}",
                           channel(beyond.channel), window_text(frame.width, frame.height), worst.x, worst.y,
                           worst.mean, window_excess * result.range);
    if (windows && windows->fails())
        return fmt::format(
            "layer {} differs locally: the means of {} at ({}, {}) differ by {:.3g}, the limit is {:.3g}",
            channel(windows->worst.bias.channel), window_text(frame.width, frame.height), windows->worst.x,
            windows->worst.y, windows->worst.bias.off, windows->worst.bias.allowed);
    if (result.mean <= layer_share * result.range) return "";
    if (beyond.mean > layer_excess * result.range)
        return fmt::format("layer {}: mean difference {:.3g} is above the limit of {:.3g} (3 % of its range)",
                           b.name, result.mean, layer_share * result.range);
    const auto by = best_shift(frame, [&](Offset offset) { return correlation(a, b, frame, offset); });
    return by ? moved_fault(b.name, *by) : "";
}

void judge(const Picture::Layer& a, const Picture::Layer& b, bool same_samples, Frame frame,
           LayerResult& result) {
    if (b.name.empty() || result.most == 0.0) return;
    result.ids = holds_ids(a) && holds_ids(b);
    if (result.ids) return judge_ids(a, b, frame, result);
    std::optional<WindowBiases> windows;
    if (same_samples || std::ranges::find(means_over_all, b.name) != means_over_all.end()) {
        windows = window_biases(a, b, result.range, frame);
        result.found_from = windows->found_from;
        const bool is_alpha = b.name == "alpha";
        const double plain = is_alpha ? plain_alpha : plain_share * result.range;
        if (result.found_from > std::max(plain, window_bias * result.range))
            result.doubt = fmt::format(
                "layer {} could differ by {}: the means of {} are found to differ from {:.3g} on, "
                "its range is {:.3g}: render both larger, or with more samples",
                b.name, is_alpha ? fmt::format("{}", plain_alpha) : "half its range",
                window_text(frame.width, frame.height), result.found_from, result.range);
    }
    result.fault = fault_of(a, b, result, windows, frame);
}

// Robust range: between the 1st and 99th percentile, or the magnitude of the median if greater, so that
// single outliers do not count. Values equal to the median (such as a background) are excluded, unless almost
// all are equal to it.
double usual_range(std::vector<float> values) {
    std::ranges::sort(values);
    const float median = values[values.size() / 2];
    std::vector<float> others;
    std::ranges::copy_if(values, std::back_inserter(others), [&](float v) { return v != median; });
    constexpr size_t outlier_ratio = 1000; // one in this many
    if (others.size() * outlier_ratio < values.size() || others.empty()) return std::abs(double(median));
    const double low = double(others[others.size() / 100]), high = double(others[others.size() * 99 / 100]);
    const double spread = std::max(high, double(median)) - std::min(low, double(median));
    return std::max(spread, std::abs(double(median)));
}

} // namespace

LayerResult compare_layer(const Picture::Layer& a, const Picture::Layer& b, int width, int height,
                          bool same_samples) {
    LayerResult result;
    result.name = b.name;
    result.channels = int(b.channels.size());
    double squares = 0.0, sum = 0.0, mean = 0.0, low = 0.0, high = b.name.empty() ? 1.0 : 0.0;
    for (const float v : b.pixels) {
        low = std::min(low, double(v));
        high = std::max(high, double(v));
        mean += std::abs(double(v)) / double(b.pixels.size());
    }
    const double least = 0.01 * mean * mean + 1e-30; // bounds the error of black pixels
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
    if (!b.name.empty())
        if (const double usual = usual_range(b.pixels); usual > 0.0) result.range = usual;
    result.rmse = std::sqrt(squares / count);
    result.relative_mse = relative / count;
    result.mean = sum / count;
    result.psnr = result.rmse > 0.0 ? 20.0 * std::log10(result.range / result.rmse)
                                    : std::numeric_limits<double>::infinity();
    judge(a, b, same_samples, {width, height}, result);
    return result;
}

} // namespace marram
