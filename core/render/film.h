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
//   any name   1 ... 4   that curve attribute, mean over the samples that hit a curve which carries it; of one that
//                        is a name (discrete: an id) the value of the first such sample
#pragma once

#include "core/geometry/hit.h"
#include "core/math/problem.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

enum class LayerKind : uint8_t { beauty, variance, alpha, albedo, normal, depth, strand_u, attribute };

struct FilmLayer {
    std::string name;
    LayerKind kind = LayerKind::beauty;
    uint32_t channels = 3;
    uint32_t first = 0;        // of its values in a pixel's sums
    uint32_t sums = 3;         // of which so many, and the number of samples that count
    std::vector<float> pixels; // filled by resolve: rows from the top, channels interleaved
};

struct Film {
    uint32_t width = 0, height = 0;
    std::vector<FilmLayer> layers;
    uint32_t stride = 0;      // doubles a pixel: for each layer its sums and the number of samples that count
    std::vector<double> sums; // width * height * stride

    // Where render stands, a pixel: with the sums, all that it needs to go on with a film as if it had never stopped.
    std::vector<uint32_t>
        reached; // samples of its sequence that it is through with: taken, or left out since it was good enough
    std::vector<uint32_t>
        taken; // of them, samples that were taken, those dropped for not being finite among them
    std::vector<uint8_t> done;              // whether the pass under way leaves it out
    std::vector<double> luminance, squares; // sums over samples of their luminance and of its square
    std::vector<double> ended_blocks;       // sum over blocks of film_block samples of the luminance in each
    std::vector<double> block_squares;      // and of its square
    std::vector<double> clamped;            // and of the luminance that a clamp took
    // Standard deviation of a sample's luminance around it, when the pass under way began; 0: not known.
    std::vector<float> spread;
};

// Samples of a pixel that are well spread in themselves: its sequence from a multiple of so many on.
constexpr uint32_t film_block = 16;

// A sample's luminance; the end of a block, after its last sample.
void add_luminance(Film& film, size_t pixel, double luminance);
void end_block(Film& film, size_t pixel);

// Samples that pixels have taken.
struct SampleCount {
    uint32_t most = 0;  // of a pixel
    uint64_t total = 0; // of all
    double mean = 0.0;  // of a pixel
};
SampleCount count_samples(const Film& film);

// The share of the picture's light that a clamp took: of the pixels' means, however many samples each has.
double clamped_share(const Film& film);

// Of the mean of `count` numbers, from their sum and that of their squares; 0 for fewer than two.
double variance_of_mean(double sum, double squares, double count);

// Channels of a layer in this world; 0: there is no such layer.
uint32_t layer_channels(std::string_view name, const World& world);

// Throws InputError (without a place) that names an unknown layer and the known ones. Names must differ.
Film make_film(uint32_t width, uint32_t height, std::span<const std::string> names, const World& world);

// Forgets all samples: the film as make_film made it.
void clear(Film& film);

// Fills the layers' pixels from the sums; after a cancelled render each pixel is the mean of what it has.
void resolve(Film& film);

// nullptr where the film has no such layer.
const FilmLayer* find_layer(const Film& film, std::string_view name);

} // namespace marram
