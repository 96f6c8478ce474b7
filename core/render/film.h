// SPDX-License-Identifier: Apache-2.0
// The film: named layers (AOVs), each a float image. All use the same filter (filter.h: samples are placed
// by the filter and have equal weight).
//
//   layer      channels  what a pixel holds
//   beauty     3         mean radiance, premultiplied by alpha where a light at infinity is invisible
//   variance   3         variance of beauty's mean, estimated as if samples were independent: an upper
//                        estimate, since samples are stratified; 0 for a single sample
//   alpha      1         fraction of samples that hit a surface; on a shadow catcher the share of its light that others block
//   albedo     3         mean over all samples of the first hit's albedo (0 where nothing is hit)
//   normal     3         mean over all samples of the first hit's shading normal, towards the camera, world space
//   depth      1         mean distance along the ray to the first hit over the samples that hit, metres; 0 if
//                        none hit
//   strand_u   1         mean position on the strand, 0 root ... 1 tip, over the samples that hit a strand
//   any name   1 ... 4   that attribute: mean over the samples that hit a curve or mesh with this attribute.
//                        A discrete attribute (an id) has the value of the first such sample
#pragma once

#include "core/math/problem.h"
#include "core/trace/hit.h"

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

enum class LayerKind : uint8_t { beauty, variance, alpha, albedo, normal, depth, strand_u, attribute };

// A layer that is available in every scene.
struct BuiltInLayer {
    std::string_view name;
    LayerKind kind = LayerKind::beauty;
    uint32_t channels = 0;
    std::string_view channel_names, help;           // channel_names: separated by spaces, as in an EXR
    std::optional<std::pair<double, double>> range; // that its values have in any scene
    bool always = false;                            // written without being asked for
};
std::span<const BuiltInLayer> built_in_layers();

struct FilmLayer {
    std::string name;
    LayerKind kind = LayerKind::beauty;
    uint32_t channels = 3;
    uint32_t sums_offset = 0;  // offset of this layer in a pixel's sums
    uint32_t sum_count = 3;    // number of its sums; the layer's sample count follows them
    std::vector<float> values; // filled by resolve: rows from the top, channels interleaved
};

// State of a pixel. A resumed render needs this, the sums of the layers and CatcherSums, nothing else.
struct FilmPixel {
    uint32_t next_sample = 0; // index in its sequence; earlier ones were taken, or skipped when converged
    uint32_t samples = 0;     // taken, including non-finite ones
    bool converged = false;   // skipped by the current pass
    double luminance_sum = 0.0, luminance_sq_sum = 0.0; // over finite samples: of luminance and of its square
    double block_luminance_sum = 0.0;    // of luminance over complete blocks of samples_per_block samples
    double block_luminance_sq_sum = 0.0; // over complete blocks: of the square of a block's luminance sum
    double clamped_luminance_sum = 0.0;  // luminance that RenderSettings::indirect_clamp removed
    // Standard deviation of one sample's luminance, from the variance averaged over the 5x5 neighbourhood
    // after the last complete pass; 0: not yet known.
    float luminance_stddev = 0.0F;
    bool operator==(const FilmPixel&) const = default;
};

// Visits every field of a pixel, in file order. A new field does not compile until it is named here.
template <typename Pixel, typename Visit>
constexpr void visit_fields(Pixel& pixel, Visit&& visit) {
    auto& [next_sample, samples, converged, luminance_sum, luminance_sq_sum, block_luminance_sum,
           block_luminance_sq_sum, clamped_luminance_sum, luminance_stddev] = pixel;
    const auto each = [&](auto&... fields) { (visit(fields), ...); };
    each(next_sample, samples, converged, luminance_sum, luminance_sq_sum, block_luminance_sum,
         block_luminance_sq_sum, clamped_luminance_sum, luminance_stddev);
}
inline constexpr uint32_t film_pixel_field_count = [] {
    FilmPixel pixel;
    uint32_t count = 0;
    visit_fields(pixel, [&](const auto&) { ++count; });
    return count;
}();

// Over the samples of a pixel that hit a shadow catcher: their number, the luminance of direct light that
// it scatters, and that without shadows.
struct CatcherSums {
    double samples = 0.0, lit = 0.0, full = 0.0;
    bool operator==(const CatcherSums&) const = default;
};

struct Film {
    uint32_t width = 0, height = 0;
    std::vector<FilmLayer> layers;
    uint32_t stride = 0;      // doubles per pixel: for each layer its sums and its sample count
    std::vector<double> sums; // width * height * stride

    std::vector<FilmPixel> pixel_states; // width * height
    std::vector<CatcherSums> catchers;   // width * height; empty: no mesh of the world is a shadow catcher
    bool transparent = false; // pictures without an alpha channel of their own, such as PNG, need one
};

// Each aligned block of 16 samples of a pixel's sequence is a stratified (0,4,2)-net in the first two
// dimensions of each set of the sampler (sampler.h).
constexpr uint32_t samples_per_block = 16;

// add_luminance: called after each sample. end_block: called after the last sample of a block.
void add_luminance(FilmPixel& pixel, double luminance);
void end_block(FilmPixel& pixel);

// Number of samples taken.
struct SampleCount {
    uint32_t max = 0;   // over pixels
    uint64_t total = 0; // of all pixels
    double mean = 0.0;  // per pixel
};
SampleCount count_samples(const Film& film);

// Sum, minimum and maximum of next_sample over the pixels.
struct FilmProgress {
    uint64_t sum = 0;
    uint32_t min = 0, max = 0;
};
FilmProgress progress_of(const Film& film);

// Fraction of the picture's light that RenderSettings::indirect_clamp removed, from pixel means: pixels have
// equal weight.
double clamped_fraction(const Film& film);

// Variance of the mean of `count` numbers, from their sum and sum of squares; 0 for fewer than two.
double variance_of_mean(double sum, double squares, double count);

// Number of channels of a layer in this world; 0: unknown layer.
uint32_t layer_channels(std::string_view name, const World& world);

// Throws InputError, without a file position, that names an unknown layer and lists the known ones. Names
// must be unique. Adds no layer to `names`: layer_names (core/shot/frame.h) adds beauty and alpha, which are
// always written.
Film make_film(uint32_t width, uint32_t height, std::span<const std::string> names, const World& world);

// Removes all samples: the state after make_film.
void clear(Film& film);

// Computes the values of the layers from the sums; each pixel is the mean of the samples it has so far.
void resolve(Film& film);

// nullptr if the film has no such layer.
const FilmLayer* find_layer(const Film& film, std::string_view name);

} // namespace marram
