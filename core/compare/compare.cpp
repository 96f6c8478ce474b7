// SPDX-License-Identifier: Apache-2.0
#include "core/compare/compare.h"

#include "core/compare/compare_layers.h"
#include "core/compare/flip.h"
#include "core/compare/windows.h"
#include "core/math/color.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <sstream>

namespace marram {
namespace {

// Limits without variance. Measured between renders of this project's scenes at 64 and 1024 samples, which
// look the same to most people, and between pictures with a strand shifted by half a pixel, which do not.
constexpr double plain_flip_mean = 0.03, plain_flip_99 = 0.25, plain_ssim = 0.9;
constexpr double plain_flip_window = 0.35; // measurements: core/compare/compare.h
constexpr double plain_below_zero = 0.03;  // of the reference's light
constexpr double much_noisier = 4.0;       // ratio of the mean variances
constexpr double noisy_flip_mean = 0.5;    // independent of the variance
constexpr double level = 1e-3;             // probability of a false alarm, over all squares of all sizes

const Picture::Layer& picture_proper(const Picture& picture, const std::string& name) {
    const Picture::Layer* layer = picture.find("");
    if (!layer || layer->channels.size() < 3)
        throw InputError({name}, "has no channels R, G and B", "compare pictures in colour, or grey ones");
    return *layer;
}

std::vector<float> colours_of(const Picture::Layer& layer) {
    const size_t channels = layer.channels.size(), pixels = layer.pixels.size() / channels;
    std::vector<float> rgb(3 * pixels);
    for (size_t i = 0; i < pixels; ++i)
        std::copy_n(layer.pixels.data() + channels * i, 3, rgb.data() + 3 * i);
    return rgb;
}

// ---- noise ----------------------------------------------------------------------------------------------------------

// The variance, at least the mean of its eight neighbours.
std::vector<double> guarded(const std::vector<float>& variance, int width, int height) {
    std::vector<double> out(variance.size());
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < 3; ++c) {
                double sum = 0.0;
                int count = 0;
                for (int j = std::max(y - 1, 0); j <= std::min(y + 1, height - 1); ++j)
                    for (int i = std::max(x - 1, 0); i <= std::min(x + 1, width - 1); ++i) {
                        if (i == x && j == y) continue;
                        sum += double(variance[3 * (size_t(j) * size_t(width) + size_t(i)) + size_t(c)]);
                        ++count;
                    }
                const size_t at = 3 * (size_t(y) * size_t(width) + size_t(x)) + size_t(c);
                out[at] = std::max(double(variance[at]), count > 0 ? sum / count : 0.0);
            }
    return out;
}

// Relative error of a colour stored as half float; a difference that is negligible relative to the picture's
// mean; the smallest half: a golden frame's variance below it is stored as 0, and a colour may be off by half
// of it.
constexpr double rounding = 0x1p-12, nothing = 1e-4, least_half = 0x1p-24;

ScaleResult worst_of(const std::vector<float>& test, const std::vector<float>& reference,
                     const std::vector<double>& variance, double least, int width, int height, int size) {
    ScaleResult worst;
    worst.size = size;
    const int w = size > 0 ? size : width, h = size > 0 ? size : height;
    for (int y = 0; y < height; y += h)
        for (int x = 0; x < width; x += w)
            for (int c = 0; c < 3; ++c) {
                double difference = 0.0, squares = 0.0;
                for (int j = y; j < std::min(y + h, height); ++j)
                    for (int i = x; i < std::min(x + w, width); ++i) {
                        const size_t at = 3 * (size_t(j) * size_t(width) + size_t(i)) + size_t(c);
                        difference += double(test[at]) - double(reference[at]);
                        const double rounded = rounding * double(reference[at]);
                        squares += variance[at] + rounded * rounded + least;
                    }
                const double off = std::abs(difference) / std::sqrt(squares);
                if (!(off <= worst.worst)) {
                    worst.worst = off;
                    worst.x = x;
                    worst.y = y;
                    worst.channel = c;
                }
            }
    return worst;
}

// The variance layer; nullptr if there is none, or for a single sample, where it is meaningless.
const Picture::Layer* variance_of(const Picture& picture) {
    return picture.samples == 1 ? nullptr : picture.find("variance");
}

void report_deviations(Comparison& result) {
    const auto failing = std::ranges::count_if(result.scales, &ScaleResult::fails);
    if (failing == 0) return;
    const ScaleResult* worst = result.worst_scale();
    const std::string where = worst->size == 1   ? fmt::format("pixel ({}, {}) is", worst->x, worst->y)
                              : worst->size == 0 ? std::string("the whole picture is")
                                                 : fmt::format("{0} x {0} pixels at ({1}, {2}) are",
                                                               worst->size, worst->x, worst->y);
    result.faults.push_back(fmt::format(
        "more than noise: {} off in {} by {:.3g} standard deviations, the limit is {:.3g}{}", where,
        std::array{"red", "green", "blue"}[size_t(worst->channel)], worst->worst, worst->limit,
        failing > 1 ? fmt::format(" ({} of {} sizes of squares fail)", failing, result.scales.size()) : ""));
}

// A much greater variance of A than of B is accepted, but noted.
void note_noise(const Picture::Layer& test, const Picture::Layer& reference, Comparison& result) {
    double mine = 0.0, theirs = 0.0;
    for (const float v : test.pixels) mine += double(v);
    for (const float v : reference.pixels) theirs += double(v);
    if (mine > much_noisier * theirs)
        result.notes.push_back(
            theirs > 0.0
                ? fmt::format("the mean variance of A is {:.3g} times that of B: noise may hide differences",
                              mine / theirs)
                : std::string("the mean variance of B is 0, that of A is not: noise may hide differences"));
}

void judge_noise(const Picture& test, const Picture& reference, const std::vector<float>& a,
                 const std::vector<float>& b, const std::optional<Limits>& limits, Comparison& result) {
    const Picture::Layer *va = variance_of(test), *vb = variance_of(reference);
    result.unknown = test.samples == 1 || reference.samples == 1
                         ? "one sample a pixel has no variance"
                         : "neither picture has a layer \"variance\" (--aov variance)";
    if (!va && !vb) return;
    // A picture without variance is assumed as noisy as the other, scaled by the sample counts.
    const bool known = test.samples > 0 && reference.samples > 0;
    result.unknown =
        "only one picture has a layer \"variance\", and a sample count (marram:samples) is missing";
    if (!limits && !(va && vb) && !known) return;
    result.unknown.clear();
    if (va && vb && !limits) note_noise(*va, *vb, result);
    const double more = known ? double(test.samples) / double(reference.samples) : 1.0;
    result.has_noise_estimate = true;
    std::vector<float> variance(a.size());
    for (size_t i = 0; i < variance.size(); ++i) {
        const double mine = va ? double(va->pixels[i]) : double(vb->pixels[i]) / more;
        const double theirs = vb ? double(vb->pixels[i]) : double(va->pixels[i]) * more;
        constexpr double largest = 3e38;
        // The variance of a golden frame is that of the difference.
        variance[i] = float(std::min(limits && vb ? theirs : mine + theirs, largest));
    }
    const Halves halves = limits                        ? Halves::variance
                          : test.half || reference.half ? Halves::colours
                                                        : Halves::none;
    result.scales = deviations(a, b, variance, halves, result.width, result.height);
    double tests = 0.0;
    for (const ScaleResult& scale : result.scales) {
        const int w = scale.size > 0 ? scale.size : result.width,
                  h = scale.size > 0 ? scale.size : result.height;
        tests += 3.0 * std::ceil(double(result.width) / w) * std::ceil(double(result.height) / h);
    }
    // Unknown sample count: at least two, because otherwise there would be no variance.
    const auto samples_of = [](const Picture& picture) { return std::max(picture.samples, 2); };
    const int samples =
        va && vb ? std::min(samples_of(test), samples_of(reference)) : samples_of(va ? test : reference);
    for (ScaleResult& scale : result.scales) {
        // Path contributions are not normally distributed: a sample counts as an eighth of a degree of
        // freedom. A pixel's variance is guarded by its neighbours.
        const double pixels =
            scale.size > 0 ? double(scale.size) * scale.size : double(result.width) * result.height;
        scale.limit = student_limit(level / tests, std::max(4.0, samples / 8.0 * std::max(pixels, 9.0)));
        if (limits)
            for (const auto& [size, limit] : limits->deviations)
                if (size == scale.size) scale.limit = limit;
    }
    report_deviations(result);
}

// ---- whether they can be compared -----------------------------------------------------------------------------------

std::string list_of(const Picture& picture) {
    std::string text = picture.grey ? "Y (grey)" : "";
    for (const Picture::Layer& layer : picture.layers)
        for (const std::string& channel : layer.channels)
            if (!(picture.grey && layer.name.empty()))
                text +=
                    (text.empty() ? "" : ", ") + (layer.name.empty() ? channel : layer.name + "." + channel);
    return text;
}

void check_comparable(const Picture& a, const Picture& b, const std::string& a_name,
                      const std::string& b_name) {
    if (a.width != b.width || a.height != b.height)
        throw InputError(
            {a_name},
            fmt::format("is {} x {} pixels, {} is {} x {}", a.width, a.height, b_name, b.width, b.height),
            "compare pictures of one size");
    const auto names = [](const Picture& picture) {
        std::set<std::string> all;
        for (const Picture::Layer& layer : picture.layers)
            for (const std::string& channel : layer.channels)
                if (layer.name != "variance") all.insert(layer.name + "." + channel);
        return all;
    };
    // A golden frame requires only its own layers.
    const std::set<std::string> mine = names(a), theirs = names(b);
    if (a.grey != b.grey || (b.limits.empty() ? mine != theirs : !std::ranges::includes(mine, theirs)))
        throw InputError({a_name}, fmt::format("has channels {}; {} has {}", list_of(a), b_name, list_of(b)),
                         "write both with the same layers and format");
    for (const Picture* picture : {&a, &b}) {
        const Picture::Layer* variance = picture->find("variance");
        if (!variance) continue;
        const std::string& name = picture == &a ? a_name : b_name;
        if (variance->channels.size() != 3)
            throw InputError({name}, "its variance has not three channels",
                             "write the layer with `--aov variance`");
        if (std::ranges::any_of(variance->pixels, [](float v) { return v < 0.0F; }))
            throw InputError({name}, "its variance is negative somewhere",
                             "write the layer with `--aov variance`");
    }
    for (const auto& [picture, name] : {std::pair(&a, a_name), std::pair(&b, b_name)})
        if (!picture->limits.empty() && !limits_from(picture->limits))
            throw InputError({name}, "its limits (marram:limits) are invalid", "make the golden frame anew");
    if (!b.limits.empty() && !b.find("variance"))
        throw InputError({b_name}, "carries limits but no variance", "make the golden frame anew");
    if (!b.limits.empty() && a.samples > 0 && a.samples != b.samples)
        throw InputError(
            {a_name},
            fmt::format("has {} samples a pixel, the golden frame {} {}", a.samples, b_name, b.samples),
            fmt::format("render it with --spp {}", b.samples));
}

} // namespace

double student_limit(double p, double degrees) {
    // Normal quantile: Newton iteration from a bound on erfc.
    double z = std::sqrt(-2.0 * std::log(p));
    for (int i = 0; i < 50; ++i) {
        const double tail = std::erfc(z / std::sqrt(2.0)),
                     slope = std::sqrt(2.0 / pi) * std::exp(-0.5 * z * z);
        z += (tail - p) / slope;
    }
    const double g = (degrees - 1.5) / ((degrees - 1.0) * (degrees - 1.0));
    return std::sqrt(degrees * std::expm1(g * z * z));
}

const ScaleResult* Comparison::worst_scale() const {
    const auto share = [](const ScaleResult& scale) { return scale.worst / scale.limit; };
    const auto at = std::ranges::max_element(scales, {}, share);
    return at == scales.end() ? nullptr : &*at;
}

std::string to_text(const Limits& limits) {
    std::string text;
    for (const auto& [size, limit] : limits.deviations) text += fmt::format("{}:{:.4g} ", size, limit);
    return text +
           fmt::format("flip {:.4g} {:.4g} ssim {:.5g}", limits.flip_mean, limits.flip_99, limits.ssim);
}

std::optional<Limits> limits_from(const std::string& text) {
    Limits limits;
    std::istringstream in(text);
    std::string word;
    const auto number = [](const std::string& from, auto& to) {
        const auto [end, error] = std::from_chars(from.data(), from.data() + from.size(), to);
        return error == std::errc() && end == from.data() + from.size() && std::isfinite(double(to));
    };
    while (in >> word && word != "flip") {
        const size_t colon = word.find(':');
        int size = 0;
        double limit = 0.0;
        if (colon == std::string::npos || !number(word.substr(0, colon), size) ||
            !number(word.substr(colon + 1), limit) || size < 0 || !(limit > 0.0))
            return std::nullopt;
        limits.deviations.emplace_back(size, limit);
    }
    std::string mean, most, name, ssim, more;
    if (!(in >> mean >> most >> name >> ssim) || in >> more || name != "ssim" ||
        !number(mean, limits.flip_mean) || !number(most, limits.flip_99) || !number(ssim, limits.ssim))
        return std::nullopt;
    return limits;
}

std::vector<ScaleResult> deviations(const std::vector<float>& test, const std::vector<float>& reference,
                                    const std::vector<float>& variance, Halves halves, int width,
                                    int height) {
    const std::vector<double> guarded_variance = guarded(variance, width, height);
    double mean = 0.0;
    for (const float v : reference) mean += std::abs(double(v)) / double(reference.size());
    const double rounding_variance = halves == Halves::variance  ? least_half
                                     : halves == Halves::colours ? 0.25 * least_half * least_half
                                                                 : 0.0;
    const double least = std::max(rounding_variance, nothing * nothing * mean * mean) + 1e-60;
    std::vector<ScaleResult> scales;
    for (int size = 1; size < std::max(width, height); size *= 2)
        scales.push_back(worst_of(test, reference, guarded_variance, least, width, height, size));
    scales.push_back(worst_of(test, reference, guarded_variance, least, width, height, 0));
    return scales;
}

double mean_ssim(const std::vector<float>& test, const std::vector<float>& reference, int width, int height) {
    const auto displayed = [&](const std::vector<float>& rgb, int x, int y) {
        const float* p = rgb.data() + 3 * (size_t(y) * size_t(width) + size_t(x));
        return double(std::clamp(srgb_from_linear(luminance(p[0], p[1], p[2])), 0.0F, 1.0F));
    };
    constexpr int window = 8, step = 4;
    constexpr double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    double sum = 0.0, count = 0.0;
    for (const int y : window_starts(height, window, step))
        for (const int x : window_starts(width, window, step)) {
            double a = 0, b = 0, aa = 0, bb = 0, ab = 0, n = 0;
            for (int j = y; j < std::min(y + window, height); ++j)
                for (int i = x; i < std::min(x + window, width); ++i) {
                    const double p = displayed(test, i, j), q = displayed(reference, i, j);
                    a += p, b += q, aa += p * p, bb += q * q, ab += p * q, n += 1.0;
                }
            a /= n, b /= n;
            const double va = aa / n - a * a, vb = bb / n - b * b, cov = ab / n - a * b;
            sum += (2.0 * a * b + c1) * (2.0 * cov + c2) / ((a * a + b * b + c1) * (va + vb + c2));
            count += 1.0;
        }
    return sum / count;
}

namespace {

// Compares bit for bit, and layer by layer.
void judge_layers(const Picture& test, const Picture& reference, Comparison& result) {
    result.equal = true;
    for (const Picture::Layer& layer : reference.layers) {
        if (layer.name == "variance") continue;
        const Picture::Layer mine{layer.name, layer.channels,
                                  in_order(*test.find(layer.name), layer.channels)};
        result.equal &=
            std::memcmp(mine.pixels.data(), layer.pixels.data(), layer.pixels.size() * sizeof(float)) == 0;
        result.layers.push_back(compare_layer(mine, layer, result.width, result.height));
        if (const std::string& fault = result.layers.back().fault; !fault.empty())
            result.faults.push_back(fault);
    }
}

void judge_perception(const std::vector<float>& a, const std::vector<float>& b,
                      const std::optional<Limits>& limits, Comparison& result) {
    const int width = result.width, height = result.height;
    result.flip = flip_map(a, b, width, height, result.display ? Range::display : Range::linear);
    std::vector<float> sorted = result.flip;
    std::ranges::sort(sorted);
    for (const float f : sorted) result.flip_mean += double(f) / double(sorted.size());
    result.flip_99 = double(sorted[std::min(sorted.size() - 1, sorted.size() * 99 / 100)]);
    const WorstWindow worst = worst_window(result.flip, width, height);
    result.flip_window = worst.mean;
    result.flip_window_x = worst.x;
    result.flip_window_y = worst.y;
    result.ssim = mean_ssim(a, b, width, height);
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const bool perception_decides = !limits && !result.has_noise_estimate;
    result.flip_mean_limit = limits               ? limits->flip_mean
                             : perception_decides ? plain_flip_mean
                                                  : noisy_flip_mean;
    result.flip_99_limit = limits ? limits->flip_99 : perception_decides ? plain_flip_99 : infinity;
    result.flip_window_limit = perception_decides ? plain_flip_window : infinity;
    result.ssim_limit = limits ? limits->ssim : perception_decides ? plain_ssim : -1.0;
    const auto require = [&](bool fine, const std::string& what, double value, double limit,
                             const char* bound) {
        if (!fine)
            result.faults.push_back(fmt::format("it looks different: {} {:.3g} is {} the limit of {:.3g}",
                                                what, value, bound, limit));
    };
    require(result.flip_mean <= result.flip_mean_limit, "mean FLIP", result.flip_mean, result.flip_mean_limit,
            "above");
    require(result.flip_99 <= result.flip_99_limit, "the 99th percentile of FLIP", result.flip_99,
            result.flip_99_limit, "above");
    require(result.flip_window <= result.flip_window_limit,
            fmt::format("mean FLIP of {} at ({}, {})", window_text(width, height), worst.x, worst.y),
            result.flip_window, result.flip_window_limit, "above");
    require(result.ssim >= result.ssim_limit, "SSIM", result.ssim, result.ssim_limit, "below");
}

// FLIP and SSIM treat negative light as 0.
void judge_below_zero(const std::vector<float>& a, const std::vector<float>& b, Comparison& result) {
    if (result.golden || result.has_noise_estimate) return;
    double apart = 0.0, light = 0.0;
    for (size_t i = 0; i < b.size(); ++i) {
        apart += std::abs(std::min(double(a[i]), 0.0) - std::min(double(b[i]), 0.0));
        light += std::abs(double(b[i]));
    }
    if (apart > plain_below_zero * light)
        result.faults.push_back(
            fmt::format("its negative values differ by {:.3g} in the mean, the limit is {:.3g}",
                        apart / double(b.size()), plain_below_zero * light / double(b.size())));
}

} // namespace

Comparison compare_pictures(const Picture& test, const Picture& reference, const std::string& test_name,
                            const std::string& reference_name) {
    // The picture with limits is the reference, independent of the order.
    if (!test.limits.empty() && reference.limits.empty()) {
        Comparison result = compare_pictures(reference, test, reference_name, test_name);
        result.swapped = true;
        return result;
    }
    check_comparable(test, reference, test_name, reference_name);
    Comparison result;
    result.width = reference.width;
    result.height = reference.height;
    judge_layers(test, reference, result);
    const std::vector<float> a = colours_of(picture_proper(test, test_name)),
                             b = colours_of(picture_proper(reference, reference_name));
    const std::optional<Limits> limits = limits_from(reference.limits);
    result.golden = limits.has_value();
    judge_noise(test, reference, a, b, limits, result);
    result.display = test.display && reference.display;
    judge_perception(a, b, limits, result);
    judge_below_zero(a, b, result);
    return result;
}

} // namespace marram
