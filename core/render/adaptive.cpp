// SPDX-License-Identifier: Apache-2.0
// Adaptive sampling: the noise estimate of a pixel.
//
// The sample variance of a pixel estimates the variance of its mean as if samples were independent. Samples
// are stratified, so the true variance is smaller: much smaller at edges, little in dense fur. The gain is
// measured in blocks of samples_per_block samples, each well stratified by itself. The variance of the mean
// of nb blocks includes the gain from stratification within a block, but not the gain across blocks, and has
// only nb - 1 degrees of freedom. So the ratio of the two variances is averaged over the neighbourhood and
// multiplied with the pixel's own sample variance, which is based on many more samples.
#include "core/render/adaptive.h"

#include "core/math/color.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram {

namespace {

// Box filter: for each pixel the mean of `values` over the pixels up to `radius` away in x and y.
std::vector<double> box_filter(const Film& film, const std::vector<double>& values, uint32_t radius) {
    const uint32_t width = film.width, height = film.height;
    const auto window = [&](uint32_t x, uint32_t size) {
        return std::pair(x - std::min(x, radius), std::min(x + radius, size - 1));
    };
    std::vector<double> rows(values.size()), means(values.size());
    for (uint32_t y = 0; y < height; ++y)
        for (uint32_t x = 0; x < width; ++x) {
            const auto [first, last] = window(x, width);
            double sum = 0.0;
            for (size_t i = size_t(y) * width + first; i <= size_t(y) * width + last; ++i) sum += values[i];
            rows[size_t(y) * width + x] = sum / (last - first + 1);
        }
    for (uint32_t y = 0; y < height; ++y)
        for (uint32_t x = 0; x < width; ++x) {
            const auto [first, last] = window(y, height);
            double sum = 0.0;
            for (uint32_t j = first; j <= last; ++j) sum += rows[size_t(j) * width + x];
            means[size_t(y) * width + x] = sum / (last - first + 1);
        }
    return means;
}

// Ratio of the true variance to the sample variance: the fraction that stratification leaves, at most 1. All
// pixels of the neighbourhood have equal weight. With weights by variance, the edge of a lamp, which
// stratification resolves well, would dominate its neighbourhood.
std::vector<double> stratification_factor(const Film& film) {
    constexpr uint32_t radius = 3; // pixels: 49 pixels of 2 blocks estimate it to within a fifth
    std::vector<double> factor(film.pixel_states.size()), estimate_weight(film.pixel_states.size());
    for (size_t i = 0; i < factor.size(); ++i) {
        const FilmPixel& pixel = film.pixel_states[i];
        const uint32_t blocks = pixel.samples / samples_per_block;
        const double sample_variance =
            variance_of_mean(pixel.luminance_sum.value(), pixel.luminance_sq_sum.value(), pixel.samples);
        if (blocks < 2 || !(sample_variance > 0.0)) continue;
        estimate_weight[i] = 1.0;
        factor[i] = variance_of_mean(pixel.block_luminance_sum.value(), pixel.block_luminance_sq_sum.value(),
                                     blocks) /
                    (sample_variance * samples_per_block * samples_per_block);
    }
    factor = box_filter(film, factor, radius);
    estimate_weight = box_filter(film, estimate_weight, radius);
    for (size_t i = 0; i < factor.size(); ++i)
        factor[i] = estimate_weight[i] > 0.0 ? std::min(factor[i] / estimate_weight[i], 1.0) : 1.0;
    return factor;
}

// Mean brightness, with values clipped at the 95th percentile: the sun's disc or a lamp counts no more than
// the brightest of the rest. Plain mean if the 95th percentile is 0.
double clipped_mean(const std::vector<double>& brightness) {
    std::vector<double> sorted = brightness;
    const auto percentile_95 = sorted.begin() + long(sorted.size() - 1 - sorted.size() / 20);
    std::ranges::nth_element(sorted, percentile_95);
    const double limit = *percentile_95 > 0.0 ? *percentile_95 : std::numeric_limits<double>::infinity();
    double sum = 0.0;
    for (const double b : brightness) sum += std::min(b, limit);
    return sum / double(brightness.size());
}

} // namespace

// Standard deviation of one sample's luminance: the variance is averaged over the 5x5 neighbourhood.
void update_luminance_stddev(Film& film) {
    std::vector<double> variances(film.pixel_states.size());
    for (size_t i = 0; i < variances.size(); ++i) {
        const FilmPixel& pixel = film.pixel_states[i];
        variances[i] = pixel.samples * variance_of_mean(pixel.luminance_sum.value(),
                                                        pixel.luminance_sq_sum.value(), pixel.samples);
    }
    variances = box_filter(film, variances, stddev_radius);
    for (size_t i = 0; i < variances.size(); ++i)
        film.pixel_states[i].luminance_stddev = float(std::sqrt(variances[i]));
}

// noise_threshold: target ratio of the standard error of a pixel's mean to its brightness. A pixel with a
// noisy neighbour continues too, since its few samples may all have missed the source of the noise.
size_t mark_converged_pixels(Film& film, double noise_threshold) {
    const FilmLayer* layer = find_layer(film, "variance");
    const auto layer_index = size_t(layer - film.layers.data());
    const size_t pixel_count = static_cast<size_t>(film.width) * film.height;
    const std::vector<double> factor = stratification_factor(film);
    std::vector<double> brightness(pixel_count), standard_error(pixel_count);
    for (size_t i = 0; i < pixel_count; ++i) {
        const Int128* sums = film.sums.data() + i * film.stride + layer->sums_offset;
        const double count = std::max(film.counts[i * film.layers.size() + layer_index], 1U);
        double sum[3], variance[3];
        for (size_t c = 0; c < 3; ++c) {
            sum[c] = ValueSum::to_double(sums[c]);
            variance[c] = variance_of_mean(sum[c], SquareSum::to_double(sums[c + 3]), count);
        }
        brightness[i] = luminance(sum[0], sum[1], sum[2]) / count;
        standard_error[i] = std::sqrt(luminance(variance[0], variance[1], variance[2]) * factor[i]);
    }
    const double mean = clipped_mean(brightness);
    const auto noisy = [&](size_t i) {
        return standard_error[i] > noise_threshold * std::max(brightness[i], 0.1 * mean);
    };
    for (FilmPixel& pixel : film.pixel_states) pixel.converged = true;
    for (uint32_t y = 0; y < film.height; ++y)
        for (uint32_t x = 0; x < film.width; ++x) {
            if (!noisy(static_cast<size_t>(y) * film.width + x)) continue;
            for (uint32_t j = y - std::min(y, 1U); j <= std::min(y + 1, film.height - 1); ++j)
                for (uint32_t i = x - std::min(x, 1U); i <= std::min(x + 1, film.width - 1); ++i)
                    film.pixel_states[static_cast<size_t>(j) * film.width + i].converged = false;
        }
    return size_t(std::ranges::count(film.pixel_states, false, &FilmPixel::converged));
}

} // namespace marram
