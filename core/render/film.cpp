// SPDX-License-Identifier: Apache-2.0
// Sums are doubles, added in the order of a pixel's samples by the one thread that has the pixel: the same
// bits always.
#include "core/render/film.h"

#include <algorithm>
#include <numeric>

namespace marram {

namespace {

struct BuiltIn {
    std::string_view name;
    LayerKind kind;
    uint32_t channels;
};

constexpr BuiltIn built_in[] = {
    {"beauty", LayerKind::beauty, 3},     {"variance", LayerKind::variance, 3},
    {"alpha", LayerKind::alpha, 1},       {"albedo", LayerKind::albedo, 3},
    {"normal", LayerKind::normal, 3},     {"depth", LayerKind::depth, 1},
    {"strand_u", LayerKind::strand_u, 1},
};

// Layer with that name, no pixels yet; channels 0 where there is none.
FilmLayer describe(std::string_view name, const World& world) {
    FilmLayer layer;
    layer.name = name;
    layer.channels = 0;
    for (const BuiltIn& known : built_in)
        if (known.name == name) {
            layer.kind = known.kind;
            layer.channels = known.channels;
            return layer;
        }
    layer.kind = LayerKind::attribute;
    for (const CurveGeometry& curves : world.curves)
        for (const CurveAttributeValues& attribute : curves.attributes)
            if (attribute.name == name) layer.channels = std::max(layer.channels, attribute.components);
    return layer;
}

std::string known_names(const World& world) {
    std::string names;
    for (const BuiltIn& known : built_in) names += (names.empty() ? "" : ", ") + std::string(known.name);
    for (const CurveGeometry& curves : world.curves)
        for (const CurveAttributeValues& attribute : curves.attributes)
            if (names.find(attribute.name) == std::string::npos) names += ", " + attribute.name;
    return names;
}

} // namespace

double variance_of_mean(double sum, double squares, double count) {
    return count > 1.0 ? std::max(0.0, squares - sum * sum / count) / (count * (count - 1.0)) : 0.0;
}

uint32_t layer_channels(std::string_view name, const World& world) { return describe(name, world).channels; }

Film make_film(uint32_t width, uint32_t height, std::span<const std::string> names, const World& world) {
    Film film;
    film.width = width;
    film.height = height;
    for (const std::string& name : names) {
        FilmLayer layer = describe(name, world);
        if (layer.channels == 0)
            throw InputError(Place{}, "there is no layer \"" + name + "\"", "one of " + known_names(world));
        layer.first = film.stride;
        // Of the variance: colours and their squares.
        layer.sums = layer.kind == LayerKind::variance ? 2 * layer.channels : layer.channels;
        film.stride += layer.sums + 1;
        film.layers.push_back(std::move(layer));
    }
    clear(film);
    return film;
}

void clear(Film& film) {
    const size_t pixels = static_cast<size_t>(film.width) * film.height;
    film.sums.assign(pixels * film.stride, 0.0);
    film.reached.assign(pixels, 0);
    film.taken.assign(pixels, 0);
    film.done.assign(pixels, 0);
    film.luminance.assign(pixels, 0.0);
    film.squares.assign(pixels, 0.0);
    film.ended_blocks.assign(pixels, 0.0);
    film.block_squares.assign(pixels, 0.0);
    film.clamped.assign(pixels, 0.0);
    film.spread.assign(pixels, 0.0F);
}

void add_luminance(Film& film, size_t pixel, double luminance) {
    film.luminance[pixel] += luminance;
    film.squares[pixel] += luminance * luminance;
}

void end_block(Film& film, size_t pixel) {
    const double block = film.luminance[pixel] - film.ended_blocks[pixel];
    film.block_squares[pixel] += block * block;
    film.ended_blocks[pixel] = film.luminance[pixel];
}

SampleCount count_samples(const Film& film) {
    SampleCount count;
    if (film.taken.empty()) return count;
    count.most = *std::ranges::max_element(film.taken);
    count.total = std::accumulate(film.taken.begin(), film.taken.end(), uint64_t(0));
    count.mean = static_cast<double>(count.total) / static_cast<double>(film.taken.size());
    return count;
}

double clamped_share(const Film& film) {
    double clamped = 0.0, all = 0.0;
    for (size_t pixel = 0; pixel < film.taken.size(); ++pixel) {
        if (film.taken[pixel] == 0) continue;
        clamped += film.clamped[pixel] / film.taken[pixel];
        all += (film.luminance[pixel] + film.clamped[pixel]) / film.taken[pixel];
    }
    return all > 0.0 ? clamped / all : 0.0;
}

void resolve(Film& film) {
    const size_t pixels = static_cast<size_t>(film.width) * film.height;
    for (FilmLayer& layer : film.layers) {
        layer.pixels.resize(pixels * layer.channels);
        for (size_t pixel = 0; pixel < pixels; ++pixel) {
            const double* sums = film.sums.data() + pixel * film.stride + layer.first;
            const double count = sums[layer.sums];
            for (uint32_t c = 0; c < layer.channels; ++c)
                layer.pixels[pixel * layer.channels + c] =
                    static_cast<float>(layer.kind == LayerKind::variance
                                           ? variance_of_mean(sums[c], sums[c + layer.channels], count)
                                       : count > 0.0 ? sums[c] / count
                                                     : 0.0);
        }
    }
}

const FilmLayer* find_layer(const Film& film, std::string_view name) {
    for (const FilmLayer& layer : film.layers)
        if (layer.name == name) return &layer;
    return nullptr;
}

} // namespace marram
