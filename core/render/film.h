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
//
// Sums are exact (core/math/exact_sum.h): films of different samples of a picture, added in any order, are
// the film of all of them (add_film).
#pragma once

#include "core/math/exact_sum.h"
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
    bool discrete = false;     // an attribute whose values are not averaged
    uint32_t sums_offset = 0;  // offset of this layer in a pixel's sums
    std::vector<float> values; // filled by resolve: rows from the top, channels interleaved
};

// Number of a layer's sums: beauty and the like sum their channels, "variance" colours and their squares.
inline uint32_t sum_count(const FilmLayer& layer) {
    return layer.kind == LayerKind::variance ? 2 * layer.channels : layer.channels;
}

// Of values such as colours: multiples of 5e-20, terms up to 7e13.
using ValueSum = ExactSum<-64>;
// Of squares: multiples of 6e-17, terms up to 7e16. Squares of values below 5e-9 are lost, those of values
// above 2.7e8 count as that: noise is not measured there.
using SquareSum = ExactSum<-54>;

// State of a pixel. A resumed render needs this, Film::sums, Film::counts and
// CatcherSums.
struct FilmPixel {
    uint32_t next_sample = 0; // index in its sequence; earlier ones were taken, or skipped when converged
    uint32_t samples = 0;     // taken, including non-finite ones
    bool converged = false;   // skipped by the current pass
    // Standard deviation of one sample's luminance, from the variance of the first pilot_samples averaged
    // over the 5x5 neighbourhood; 0: not yet known.
    float luminance_stddev = 0.0F;
    ValueSum luminance_sum; // over finite samples
    SquareSum luminance_sq_sum;
    ValueSum clamped_luminance_sum; // luminance that RenderSettings::indirect_clamp removed
    // With adaptive sampling, over complete blocks of samples_per_block samples: of luminance, and of the
    // square of a block's luminance sum.
    ValueSum block_luminance_sum;
    SquareSum block_luminance_sq_sum;
    bool operator==(const FilmPixel&) const = default;
};

// Visits every field of a pixel, in file order. A new field does not compile until it is named here.
template <typename Pixel, typename Visit>
constexpr void visit_fields(Pixel& pixel, Visit&& visit) {
    auto& [next_sample, samples, converged, luminance_stddev, luminance_sum, luminance_sq_sum,
           clamped_luminance_sum, block_luminance_sum, block_luminance_sq_sum] = pixel;
    const auto each = [&](auto&... fields) { (visit(fields), ...); };
    each(next_sample, samples, converged, luminance_stddev, luminance_sum, luminance_sq_sum,
         clamped_luminance_sum, block_luminance_sum, block_luminance_sq_sum);
}

// Over the samples of a pixel that hit a shadow catcher: their number, the luminance of direct light that
// it scatters, and that without shadows.
struct CatcherSums {
    ValueSum samples, lit, full;
    bool operator==(const CatcherSums&) const = default;
};

struct Film {
    uint32_t width = 0, height = 0;
    std::vector<FilmLayer> layers;
    uint32_t stride = 0;      // sums of a pixel, those of all layers
    std::vector<Int128> sums; // width * height * stride; units of ValueSum, of squares those of SquareSum
    // width * height * layers.size(): the number of samples that the layer has summed; of a discrete layer
    // 1 + the number of the sample whose value it has.
    std::vector<uint32_t> counts;
    std::vector<FilmPixel> pixel_states; // width * height
    std::vector<CatcherSums> catchers;   // width * height; empty: no mesh of the world is a shadow catcher
    bool transparent = false; // pictures without an alpha channel of their own, such as PNG, need one
};

// Each aligned block of 16 samples of a pixel's sequence is a stratified (0,4,2)-net in the first two
// dimensions of each set of the sampler (sampler.h).
constexpr uint32_t samples_per_block = 16;

// The first samples of a pixel, whose noise decides how often later ones trace their shadow rays
// (FilmPixel::luminance_stddev).
inline constexpr uint32_t pilot_samples = 4;

// add_luminance: called after each sample. end_block: with adaptive sampling, called after the last sample of
// a block.
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

// Adds the samples of a part of the picture, whose left top pixel is at (x, y) of the film. The part's layers
// are those of the film, and none of its samples is there already.
void add_film(Film& film, const Film& part, uint32_t x, uint32_t y);

// Computes the values of the layers from the sums; each pixel is the mean of the samples it has so far.
void resolve(Film& film);

// nullptr if the film has no such layer.
const FilmLayer* find_layer(const Film& film, std::string_view name);

} // namespace marram
