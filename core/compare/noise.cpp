// SPDX-License-Identifier: Apache-2.0
#include "core/compare/noise.h"

#include "core/math/hash.h"
#include "core/math/vec.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr double much_noisier = 4.0; // ratio of the mean variances
constexpr double level = 1e-3;       // probability of a false alarm, over all squares of all sizes
constexpr int ratio_block = 16;      // side of the blocks of the ratio test, in pixels
constexpr std::array ratio_sizes = {1, 2, 4, 8, 16};
constexpr size_t min_blocks = 9;       // fewer: their spread is unknown
constexpr double variance_error = 0.1; // relative, of the variance layer: adaptive sampling lowers it

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
constexpr double rounding = 0x1p-12, nothing = 1e-4, min_half = 0x1p-24;

ScaleResult worst_of(const std::vector<float>& test, const std::vector<float>& reference,
                     const std::vector<double>& variance, double least, int width, int height, int size) {
    ScaleResult worst;
    worst.size = size;
    std::vector<double> per_pixel; // standard deviation of each square's mean
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
                const double deviation = std::sqrt(squares), off = std::abs(difference) / deviation;
                per_pixel.push_back(deviation / (double(std::min(w, width - x)) * std::min(h, height - y)));
                if (!(off <= worst.worst)) {
                    worst.worst = off;
                    worst.x = x;
                    worst.y = y;
                    worst.channel = c;
                }
            }
    const auto middle = per_pixel.begin() + long(per_pixel.size() / 2);
    std::ranges::nth_element(per_pixel, middle);
    worst.deviation = *middle;
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

// The smallest variance that counts in deviations().
double min_variance(const std::vector<float>& reference, Halves halves) {
    double mean = 0.0;
    for (const float v : reference) mean += std::abs(double(v)) / double(reference.size());
    const double rounding_variance = halves == Halves::variance  ? min_half
                                     : halves == Halves::colours ? 0.25 * min_half * min_half
                                                                 : 0.0;
    return std::max(rounding_variance, nothing * nothing * mean * mean) + 1e-60;
}

// Squared differences of the squares of a block, and their sum of variances.
struct Energy {
    double squares = 0.0, variance = 0.0;
};

Energy energy_of(const std::vector<float>& a, const std::vector<float>& b, const std::vector<float>& variance,
                 int width, int height, int x0, int y0, int block, int size, double least) {
    Energy sum;
    const int x1 = std::min(x0 + block, width), y1 = std::min(y0 + block, height);
    for (int y = y0; y < y1; y += size)
        for (int x = x0; x < x1; x += size)
            for (int c = 0; c < 3; ++c) {
                double difference = 0.0;
                for (int j = y; j < std::min(y + size, y1); ++j)
                    for (int i = x; i < std::min(x + size, x1); ++i) {
                        const size_t at = 3 * (size_t(j) * size_t(width) + size_t(i)) + size_t(c);
                        const double rounded = rounding * double(b[at]);
                        difference += double(a[at]) - double(b[at]);
                        sum.variance += double(variance[at]) + rounded * rounded + least;
                    }
                sum.squares += difference * difference;
            }
    return sum;
}

// least: as in deviations(); blocks without more variance have no noise and tell nothing. Smaller pictures
// are cut into smaller blocks.
std::vector<RatioResult> energy_ratios(const std::vector<float>& a, const std::vector<float>& b,
                                       const std::vector<float>& variance, double least, double chance,
                                       int width, int height) {
    int block = ratio_block;
    while (block > 2 &&
           size_t((width + block - 1) / block) * size_t((height + block - 1) / block) < 2 * min_blocks)
        block /= 2;
    std::vector<RatioResult> results;
    for (const int size : ratio_sizes) {
        if (size > block) break;
        std::vector<double> ratios;
        for (int y = 0; y < height; y += block)
            for (int x = 0; x < width; x += block) {
                const Energy energy = energy_of(a, b, variance, width, height, x, y, block, size, least);
                if (energy.variance > 4.0 * least * 3.0 * block * block)
                    ratios.push_back(energy.squares / energy.variance);
            }
        RatioResult result;
        result.size = size;
        if (ratios.size() >= min_blocks) {
            const auto count = double(ratios.size());
            double squares = 0.0;
            for (const double ratio : ratios) result.ratio += ratio / count;
            for (const double ratio : ratios)
                squares += (ratio - result.ratio) * (ratio - result.ratio) / (count - 1.0);
            result.limit =
                1.0 + variance_error + student_limit(chance, count - 1.0) * std::sqrt(squares / count);
            results.push_back(result);
        } else if (!ratios.empty()) {
            results.push_back(result); // its limit is infinite: it finds nothing
        }
    }
    return results;
}

void report_ratios(Comparison& result) {
    for (const RatioResult& ratio : result.ratios)
        if (ratio.fails()) {
            result.faults.push_back(fmt::format("more than noise: over the picture, squared differences of "
                                                "{} are {:.3g} times the variance, the "
                                                "limit is {:.3g}",
                                                ratio.size == 1 ? std::string("pixels")
                                                                : fmt::format("{0} x {0} pixels", ratio.size),
                                                ratio.ratio, ratio.limit));
            return;
        }
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

std::vector<ScaleResult> deviations(const std::vector<float>& test, const std::vector<float>& reference,
                                    const std::vector<float>& variance, Halves halves, int width,
                                    int height) {
    const std::vector<double> guarded_variance = guarded(variance, width, height);
    const double least = min_variance(reference, halves);
    std::vector<ScaleResult> scales;
    for (int size = 1; size < std::max(width, height); size *= 2)
        scales.push_back(worst_of(test, reference, guarded_variance, least, width, height, size));
    scales.push_back(worst_of(test, reference, guarded_variance, least, width, height, 0));
    return scales;
}

const ScaleResult* Comparison::worst_scale() const {
    const auto share = [](const ScaleResult& scale) { return scale.worst / scale.limit; };
    const auto at = std::ranges::max_element(scales, {}, share);
    return at == scales.end() ? nullptr : &*at;
}

std::vector<float> variance_of_difference(const Picture& test, const Picture& reference,
                                          const std::optional<Limits>& limits, Comparison& result) {
    const Picture::Layer *va = variance_of(test), *vb = variance_of(reference);
    result.unknown = test.samples == 1 || reference.samples == 1
                         ? "one sample a pixel has no variance"
                         : "neither picture has a layer \"variance\" (--aov variance)";
    if (!va && !vb) return {};
    // A picture without variance is assumed as noisy as the other, scaled by the sample counts.
    const bool known = test.samples > 0 && reference.samples > 0;
    result.unknown =
        "only one picture has a layer \"variance\", and a sample count (marram:samples) is missing";
    if (!limits && !(va && vb) && !known) return {};
    result.unknown.clear();
    if (va && vb && !limits) note_noise(*va, *vb, result);
    const double more = known ? double(test.samples) / double(reference.samples) : 1.0;
    std::vector<float> variance((va ? va : vb)->pixels.size());
    for (size_t i = 0; i < variance.size(); ++i) {
        const double mine = va ? double(va->pixels[i]) : double(vb->pixels[i]) / more;
        const double theirs = vb ? double(vb->pixels[i]) : double(va->pixels[i]) * more;
        constexpr double largest = 3e38;
        // The variance of a golden frame is that of the difference.
        variance[i] = float(std::min(limits && vb ? theirs : mine + theirs, largest));
    }
    return variance;
}

void judge_noise(const Picture& test, const Picture& reference, const std::vector<float>& a,
                 const std::vector<float>& b, const std::vector<float>& variance,
                 const std::optional<Limits>& limits, Comparison& result) {
    const Picture::Layer *va = variance_of(test), *vb = variance_of(reference);
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
    if (!limits) tests += double(ratio_sizes.size());
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
    if (limits)
        return; // they are measured, and have no need of a test that assumes that the variance is right
    result.ratios =
        energy_ratios(a, b, variance, min_variance(b, halves), level / tests, result.width, result.height);
    report_ratios(result);
}

std::vector<float> with_hidden_difference(const std::vector<float>& reference,
                                          const std::vector<float>& variance, int size, double times,
                                          int width, int height) {
    std::vector<float> changed = reference;
    for (int y = 0; y < height; y += size)
        for (int x = 0; x < width; x += size) {
            const double sign =
                hash(uint64_t(size), uint64_t(y) * uint64_t(width) + uint64_t(x)) % 2 == 0 ? 1.0 : -1.0;
            const int x1 = std::min(x + size, width), y1 = std::min(y + size, height);
            for (int c = 0; c < 3; ++c) {
                const auto at = [&](int i, int j) {
                    return 3 * (size_t(j) * size_t(width) + size_t(i)) + size_t(c);
                };
                double sum = 0.0;
                for (int j = y; j < y1; ++j)
                    for (int i = x; i < x1; ++i) sum += double(variance[at(i, j)]);
                const double change = sign * times * std::sqrt(sum) / (double(x1 - x) * (y1 - y));
                for (int j = y; j < y1; ++j)
                    for (int i = x; i < x1; ++i) changed[at(i, j)] += float(change);
            }
        }
    return changed;
}

} // namespace marram
