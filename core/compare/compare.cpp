// SPDX-License-Identifier: Apache-2.0
#include "core/compare/compare.h"

#include "core/compare/compare_layers.h"
#include "core/compare/flip.h"
#include "core/compare/noise.h"
#include "core/compare/windows.h"
#include "core/math/color.h"
#include "core/math/problem.h"

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
constexpr double noisy_flip_mean = 0.5;    // independent of the variance
// Mean FLIP of a difference that is just noticed everywhere: 2.3 in L* (M. Mahy et al., 1994), unfiltered.
constexpr double noticed_flip_mean = 0.1;

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
    const bool same_samples = test.samples == reference.samples || test.samples < 1 || reference.samples < 1;
    for (const Picture::Layer& layer : reference.layers) {
        if (layer.name == "variance") continue;
        const Picture::Layer mine{layer.name, layer.channels,
                                  in_order(*test.find(layer.name), layer.channels)};
        result.equal &=
            std::memcmp(mine.pixels.data(), layer.pixels.data(), layer.pixels.size() * sizeof(float)) == 0;
        result.layers.push_back(compare_layer(mine, layer, result.width, result.height, same_samples));
        if (const std::string& fault = result.layers.back().fault; !fault.empty())
            result.faults.push_back(fault);
    }
}

struct Looks {
    std::vector<float> flip;
    double flip_mean = 0.0, flip_99 = 0.0, ssim = 1.0;
    WorstWindow flip_window;
};

Looks looks_of(const std::vector<float>& a, const std::vector<float>& b, const Comparison& result) {
    const int width = result.width, height = result.height;
    Looks looks;
    looks.flip = flip_map(a, b, width, height, result.display ? Range::display : Range::linear);
    std::vector<float> sorted = looks.flip;
    std::ranges::sort(sorted);
    for (const float f : sorted) looks.flip_mean += double(f) / double(sorted.size());
    looks.flip_99 = double(sorted[std::min(sorted.size() - 1, sorted.size() * 99 / 100)]);
    looks.flip_window = worst_window(looks.flip, width, height);
    looks.ssim = mean_ssim(a, b, width, height);
    return looks;
}

// Whether noise would be known if there were more samples.
bool lacks_samples(const Picture& test, const Picture& reference, const Comparison& result) {
    return !result.golden && !result.has_noise_estimate &&
           std::ranges::any_of(std::array{&test, &reference}, [](const Picture* picture) {
               return picture->samples == 1 && picture->find("variance");
           });
}

void judge_perception(const std::vector<float>& a, const std::vector<float>& b,
                      const std::optional<Limits>& limits, bool looks_decide, Comparison& result) {
    Looks looks = looks_of(a, b, result);
    result.flip = std::move(looks.flip);
    result.flip_mean = looks.flip_mean;
    result.flip_99 = looks.flip_99;
    result.flip_window = looks.flip_window.mean;
    result.flip_window_x = looks.flip_window.x;
    result.flip_window_y = looks.flip_window.y;
    result.ssim = looks.ssim;
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const bool perception_decides = !limits && looks_decide;
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
            fmt::format("mean FLIP of {} at ({}, {})", window_text(result.width, result.height),
                        result.flip_window_x, result.flip_window_y),
            result.flip_window, result.flip_window_limit, "above");
    require(result.ssim >= result.ssim_limit, "SSIM", result.ssim, result.ssim_limit, "below");
}

bool look_alike(const Comparison& c) {
    return c.flip_mean <= plain_flip_mean && c.flip_99 <= plain_flip_99 &&
           c.flip_window <= plain_flip_window && c.ssim >= plain_ssim;
}

// How far a difference is beyond what is noticed, as the factor of samples that lowers it to that: FLIP grows
// with a difference to the power 0.7. Not by the other limits: noise has a low SSIM and single pixels far
// off, however weak it looks.
struct Beyond {
    double factor = 0.0;
    std::string what;
};

Beyond beyond_notice(const Looks& looks) {
    const auto flip = [](double value, double limit, const char* name) {
        return Beyond{std::pow(value / limit, 2.0 / 0.7),
                      fmt::format("{} {:.3g}, above {:.3g}", name, value, limit)};
    };
    return std::max(flip(looks.flip_mean, noticed_flip_mean, "mean FLIP"),
                    flip(looks.flip_window.mean, plain_flip_window, "FLIP of the worst window"),
                    [](const Beyond& a, const Beyond& b) { return a.factor < b.factor; });
}

std::string samples_text(double factor, int samples) {
    if (samples < 1) return fmt::format("{:.2g} times as many samples", factor);
    return fmt::format("about {:.0f} samples a pixel",
                       std::exp2(std::ceil(std::log2(factor * double(samples)))));
}

// Where noise explains what looks different: whether it could also hide a difference that would be noticed.
void judge_power(const Picture& test, const Picture& reference, const std::vector<float>& b,
                 const std::vector<float>& variance, Comparison& result) {
    if (lacks_samples(test, reference, result) && result.alike() && !look_alike(result))
        result.doubt =
            "the difference may be noise: one sample a pixel has no variance: render both with more";
    if (result.golden || variance.empty() || result.equal || !result.alike() || look_alike(result)) return;
    double factor = 1.0;
    std::string what;
    for (const RatioResult& ratio : result.ratios) {
        if (ratio.size != 1 && ratio.size != 4 && ratio.size != 16) continue; // those between are alike
        if (std::isinf(ratio.limit)) {
            result.doubt = "noise could hide any difference: too few pixels have noise to judge it by; "
                           "render both larger, or with more samples";
            return;
        }
        // The factor is extrapolated from the looks with the samples so far: until it holds.
        constexpr int max_rounds = 5;
        for (int round = 0; round < max_rounds; ++round) {
            const double times = std::sqrt(ratio.limit / factor);
            const Beyond beyond = beyond_notice(
                looks_of(with_hidden_difference(b, variance, ratio.size, times, result.width, result.height),
                         b, result));
            if (beyond.factor <= 1.0) break;
            if (what.empty()) what = beyond.what;
            factor *= std::max(beyond.factor, 1.1);
        }
    }
    if (factor > 1.0)
        result.doubt =
            fmt::format("noise could hide a difference that people would see ({}): render both with {}", what,
                        samples_text(factor, std::max(test.samples, reference.samples)));
}

// Whether noise of other layers could hide a plain difference.
void judge_layer_power(const Picture& test, const Picture& reference, Comparison& result) {
    if (result.golden || result.different()) return;
    for (const LayerResult& layer : result.layers)
        if (!layer.doubt.empty()) result.doubt += (result.doubt.empty() ? "" : "; ") + layer.doubt;
    for (const LayerResult& layer : result.layers)
        if (!layer.name.empty() && !layer.ids && layer.most > 0.0 && layer.found_from == 0.0)
            result.notes.push_back(
                fmt::format("layer {} depends on the number of samples a pixel, A has {}, B {}: "
                            "noise may hide local differences",
                            layer.name, test.samples, reference.samples));
}

// FLIP and SSIM treat negative light as 0.
void judge_below_zero(const std::vector<float>& a, const std::vector<float>& b, Comparison& result) {
    if (result.golden) return;
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
    result.display = test.display && reference.display;
    for (const float v : b) result.light += std::abs(double(v)) / double(b.size());
    const std::vector<float> variance = variance_of_difference(test, reference, limits, result);
    result.has_noise_estimate = !variance.empty();
    if (result.has_noise_estimate) judge_noise(test, reference, a, b, variance, limits, result);
    const bool looks_decide = !result.has_noise_estimate && !lacks_samples(test, reference, result);
    judge_perception(a, b, limits, looks_decide, result);
    if (looks_decide) judge_below_zero(a, b, result);
    judge_power(test, reference, b, variance, result);
    judge_layer_power(test, reference, result);
    return result;
}

} // namespace marram
