// SPDX-License-Identifier: Apache-2.0
#include "core/render/film.h"

#include <algorithm>

namespace marram {

namespace {

template <typename Visit>
void for_each_attribute(const World& world, Visit&& visit) {
    for (const MeshGeometry& mesh : world.meshes) std::ranges::for_each(mesh.attributes, visit);
    for (const CurveGeometry& curves : world.curves) std::ranges::for_each(curves.attributes, visit);
}

// A layer of this name, without values; 0 channels if it is unknown.
FilmLayer describe(std::string_view name, const World& world) {
    FilmLayer layer;
    layer.name = name;
    layer.channels = 0;
    for (const BuiltInLayer& known : built_in_layers())
        if (known.name == name) {
            layer.kind = known.kind;
            layer.channels = known.channels;
            return layer;
        }
    layer.kind = LayerKind::attribute;
    for_each_attribute(world, [&](const AttributeValues& attribute) {
        if (attribute.name != name) return;
        layer.channels = std::max(layer.channels, attribute.components);
        layer.discrete |= attribute.discrete;
    });
    return layer;
}

std::string known_names(const World& world) {
    std::vector<std::string> names;
    const auto add = [&](std::string_view name) {
        if (std::ranges::find(names, name) == names.end()) names.emplace_back(name);
    };
    for (const BuiltInLayer& known : built_in_layers()) add(known.name);
    for_each_attribute(world, [&](const AttributeValues& attribute) { add(attribute.name); });
    std::string text;
    for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
    return text;
}

} // namespace

std::span<const BuiltInLayer> built_in_layers() {
    using enum LayerKind;
    static constexpr BuiltInLayer layers[] = {
        {"beauty", beauty, 3, "R G B", "the picture; always written", {{0, 1}}, true},
        {"alpha",
         alpha,
         1,
         "A",
         "fraction of the samples that hit a surface; always written",
         {{0, 1}},
         true},
        {"variance",
         variance,
         3,
         "R G B",
         "variance of each beauty pixel's mean; read by film.noise and by `marram compare`",
         {},
         false},
        {"albedo", albedo, 3, "R G B", "fraction of light that the first hit scatters", {{0, 1}}, false},
        {"normal",
         normal,
         3,
         "X Y Z",
         "shading normal of the first hit, towards the camera",
         {{-1, 1}},
         false},
        {"depth", depth, 1, "Z", "distance of the first hit along the ray, m", {}, false},
        {"strand_u",
         strand_u,
         1,
         "Y",
         "position along the strand, 0 at the root, 1 at the tip",
         {{0, 1}},
         false}};
    return layers;
}

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
            throw InputError(Place{}, "this scene has no image layer '" + name + "'",
                             "choose among " + known_names(world));
        layer.sums_offset = film.stride;
        film.stride += sum_count(layer);
        film.layers.push_back(std::move(layer));
    }
    // clear() keeps their number.
    if (std::ranges::any_of(world.meshes, &MeshGeometry::shadow_catcher))
        film.catchers.resize(static_cast<size_t>(width) * height);
    clear(film);
    return film;
}

void clear(Film& film) {
    const size_t pixel_count = static_cast<size_t>(film.width) * film.height;
    film.catchers.assign(film.catchers.size(), {});
    film.sums.assign(pixel_count * film.stride, 0);
    film.counts.assign(pixel_count * film.layers.size(), 0);
    film.pixel_states.assign(pixel_count, {});
}

namespace {

void add_discrete(const Int128* from, uint32_t from_count, uint32_t channels, Int128* to,
                  uint32_t& to_count) {
    if (from_count == 0 || (to_count > 0 && to_count < from_count)) return;
    std::copy_n(from, channels, to);
    to_count = from_count;
}

void add_pixel(FilmPixel& pixel, const FilmPixel& more) {
    pixel.next_sample = std::max(pixel.next_sample, more.next_sample);
    pixel.samples += more.samples;
    pixel.converged = more.next_sample == pixel.next_sample ? more.converged : pixel.converged;
    if (more.luminance_stddev > 0.0F) pixel.luminance_stddev = more.luminance_stddev;
    pixel.luminance_sum += more.luminance_sum;
    pixel.luminance_sq_sum += more.luminance_sq_sum;
    pixel.clamped_luminance_sum += more.clamped_luminance_sum;
    pixel.block_luminance_sum += more.block_luminance_sum;
    pixel.block_luminance_sq_sum += more.block_luminance_sq_sum;
}

} // namespace

void add_film(Film& film, const Film& part, uint32_t x, uint32_t y) {
    const size_t layers = film.layers.size();
    for (uint32_t row = 0; row < part.height; ++row)
        for (uint32_t column = 0; column < part.width; ++column) {
            const size_t to = size_t(y + row) * film.width + x + column,
                         from = size_t(row) * part.width + column;
            add_pixel(film.pixel_states[to], part.pixel_states[from]);
            for (size_t i = 0; i < layers; ++i) {
                const FilmLayer& layer = film.layers[i];
                Int128* sums = film.sums.data() + to * film.stride + layer.sums_offset;
                const Int128* more = part.sums.data() + from * film.stride + layer.sums_offset;
                uint32_t& count = film.counts[to * layers + i];
                const uint32_t more_count = part.counts[from * layers + i];
                if (layer.discrete) {
                    add_discrete(more, more_count, layer.channels, sums, count);
                    continue;
                }
                for (uint32_t c = 0; c < sum_count(layer); ++c) sums[c] += more[c];
                count += more_count;
            }
            if (film.catchers.empty()) continue;
            CatcherSums& caught = film.catchers[to];
            const CatcherSums& also = part.catchers[from];
            caught.samples += also.samples;
            caught.lit += also.lit;
            caught.full += also.full;
        }
}

void add_luminance(FilmPixel& pixel, double luminance) {
    pixel.luminance_sum.add(luminance);
    pixel.luminance_sq_sum.add(luminance * luminance);
}

void end_block(FilmPixel& pixel) {
    const double block_sum = (pixel.luminance_sum - pixel.block_luminance_sum).value();
    pixel.block_luminance_sq_sum.add(block_sum * block_sum);
    pixel.block_luminance_sum = pixel.luminance_sum;
}

SampleCount count_samples(const Film& film) {
    SampleCount count;
    for (const FilmPixel& pixel : film.pixel_states) {
        count.max = std::max(count.max, pixel.samples);
        count.total += pixel.samples;
    }
    if (count.total > 0)
        count.mean = static_cast<double>(count.total) / static_cast<double>(film.pixel_states.size());
    return count;
}

FilmProgress progress_of(const Film& film) {
    FilmProgress progress;
    if (!film.pixel_states.empty()) progress.min = film.pixel_states.front().next_sample;
    for (const FilmPixel& pixel : film.pixel_states) {
        progress.sum += pixel.next_sample;
        progress.min = std::min(progress.min, pixel.next_sample);
        progress.max = std::max(progress.max, pixel.next_sample);
    }
    return progress;
}

double clamped_fraction(const Film& film) {
    double clamped = 0.0, all = 0.0;
    for (const FilmPixel& pixel : film.pixel_states) {
        if (pixel.samples == 0) continue;
        clamped += pixel.clamped_luminance_sum.value() / pixel.samples;
        all += (pixel.luminance_sum.value() + pixel.clamped_luminance_sum.value()) / pixel.samples;
    }
    return all > 0.0 ? clamped / all : 0.0;
}

void resolve(Film& film) {
    const size_t pixel_count = static_cast<size_t>(film.width) * film.height;
    const auto shadow_alpha = [&](size_t i) { // alpha sum of the samples on shadow catchers
        if (film.catchers.empty()) return 0.0;
        const CatcherSums& caught = film.catchers[i];
        const double full = caught.full.value();
        return full > 0.0 ? caught.samples.value() * (1.0 - caught.lit.value() / full) : 0.0;
    };
    for (size_t l = 0; l < film.layers.size(); ++l) {
        FilmLayer& layer = film.layers[l];
        layer.values.resize(pixel_count * layer.channels);
        for (size_t pixel = 0; pixel < pixel_count; ++pixel) {
            const Int128* sums = film.sums.data() + pixel * film.stride + layer.sums_offset;
            const uint32_t counted = film.counts[pixel * film.layers.size() + l];
            const double count = layer.discrete ? 1.0 : counted;
            for (uint32_t c = 0; c < layer.channels; ++c) {
                const double sum = ValueSum::to_double(sums[c]);
                float& value = layer.values[pixel * layer.channels + c];
                if (counted == 0)
                    value = 0.0F;
                else if (layer.kind == LayerKind::variance)
                    value =
                        float(variance_of_mean(sum, SquareSum::to_double(sums[c + layer.channels]), count));
                else
                    value =
                        float((sum + (layer.kind == LayerKind::alpha ? shadow_alpha(pixel) : 0.0)) / count);
            }
        }
    }
}

const FilmLayer* find_layer(const Film& film, std::string_view name) {
    for (const FilmLayer& layer : film.layers)
        if (layer.name == name) return &layer;
    return nullptr;
}

} // namespace marram
