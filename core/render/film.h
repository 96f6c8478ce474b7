// SPDX-License-Identifier: Apache-2.0
// The film: layers by name, each a float image, all filtered alike (see filter.h: samples are placed by the
// filter and count one each).
//
//   layer      channels  what a pixel holds
//   beauty     3         mean radiance, premultiplied by alpha where a light at infinity is invisible
//   variance   3         variance of beauty's mean, as its samples tell: too much rather than too little, since samples are
//                        stratified and each counts as drawn by itself; 0 for a single sample
//   alpha      1         share of samples that hit something
//   albedo     3         mean over all samples of the first hit's albedo (0 where nothing is hit)
//   normal     3         mean over all samples of the first hit's shading normal, towards the camera, world space
//   depth      1         mean distance along the ray to the first hit over the samples that hit, metres; 0 where
//                        none does
//   strand_u   1         mean position on the strand, 0 root ... 1 tip, over the samples that hit a strand
//   any name   1 ... 4   that attribute, mean over the samples that hit a curve or mesh which carries it; of one that
//                        is a name (discrete: an id) the value of the first such sample
#pragma once

#include "core/geometry/hit.h"
#include "core/math/problem.h"

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

enum class LayerKind : uint8_t { beauty, variance, alpha, albedo, normal, depth, strand_u, attribute };

// A layer that every scene has.
struct BuiltInLayer {
    std::string_view name;
    LayerKind kind = LayerKind::beauty;
    uint32_t channels = 0;
    std::string_view channel_names, help; // names: separated by spaces, as in an EXR
};
std::span<const BuiltInLayer> built_in_layers();

struct FilmLayer {
    std::string name;
    LayerKind kind = LayerKind::beauty;
    uint32_t channels = 3;
    uint32_t first = 0;        // offset of this layer in a pixel's sums
    uint32_t sums = 3;         // number of its sums; the layer's sample count follows them
    std::vector<float> pixels; // filled by resolve: rows from the top, channels interleaved
};

// What a pixel keeps beside its layers' sums: all that render needs to go on with it as if it had never stopped.
struct FilmPixel {
    uint32_t next_sample = 0; // of its sequence: those before were taken, or skipped while it was converged
    uint32_t samples = 0;     // taken, those that were not finite included
    bool converged = false;   // the pass under way skips it
    double luminance = 0.0, squares = 0.0; // sums over samples of their luminance and its square
    double block_luminance = 0.0;          // sum over whole blocks of film_block samples of their luminance
    double block_luminance_squares = 0.0;  // sum over whole blocks of the square of a block's luminance
    double clamped = 0.0;                  // luminance that a clamp took
    // Standard deviation of a sample's luminance around this pixel, measured before the current pass; 0: unknown.
    float luminance_stddev = 0.0F;
    bool operator==(const FilmPixel&) const = default;
};

// Every field of a pixel, in the order of files. A field that is added goes here too.
template <typename Pixel, typename Visit>
void visit_fields(Pixel& pixel, Visit&& visit) {
    visit(pixel.next_sample);
    visit(pixel.samples);
    visit(pixel.converged);
    visit(pixel.luminance);
    visit(pixel.squares);
    visit(pixel.block_luminance);
    visit(pixel.block_luminance_squares);
    visit(pixel.clamped);
    visit(pixel.luminance_stddev);
}
inline constexpr uint32_t film_pixel_fields = 9;

struct Film {
    uint32_t width = 0, height = 0;
    std::vector<FilmLayer> layers;
    uint32_t stride = 0;      // doubles a pixel: for each layer its sums and the number of samples that count
    std::vector<double> sums; // width * height * stride

    std::vector<FilmPixel> pixels; // width * height
};

// Each aligned run of so many samples of a pixel's sequence is well stratified by itself.
constexpr uint32_t film_block = 16;

// A sample's luminance; the end of a block, after its last sample.
void add_luminance(FilmPixel& pixel, double luminance);
void end_block(FilmPixel& pixel);

// Samples that pixels have taken.
struct SampleCount {
    uint32_t most = 0;  // of a pixel
    uint64_t total = 0; // of all
    double mean = 0.0;  // of a pixel
};
SampleCount count_samples(const Film& film);

// Sum, least and greatest of the pixels' next_sample.
struct FilmProgress {
    uint64_t sum = 0;
    uint32_t least = 0, greatest = 0;
};
FilmProgress progress_of(const Film& film);

// The share of the picture's light that a clamp took: of the pixels' means, however many samples each has.
double clamped_share(const Film& film);

// Variance of the mean of `count` numbers, from their sum and sum of squares; 0 for fewer than two.
double variance_of_mean(double sum, double squares, double count);

// Channels of a layer in this world; 0: there is no such layer.
uint32_t layer_channels(std::string_view name, const World& world);

// Throws InputError, without a source location, that names an unknown layer and the known ones. Names must differ.
Film make_film(uint32_t width, uint32_t height, std::span<const std::string> names, const World& world);

// Forgets all samples: the film as make_film made it.
void clear(Film& film);

// Fills the layers' pixels from the sums; after a cancelled render each pixel is the mean of what it has.
void resolve(Film& film);

// nullptr where the film has no such layer.
const FilmLayer* find_layer(const Film& film, std::string_view name);

} // namespace marram
