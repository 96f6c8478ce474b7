// SPDX-License-Identifier: Apache-2.0
#include "core/render/layers.h"

namespace marram {

namespace {

// Where a layer sums: its sums in a pixel, and their count.
struct LayerSums {
    Int128* sums;
    uint32_t& count;

    void add(std::initializer_list<float> values) const {
        Int128* to = sums;
        for (const float value : values) *to++ += ValueSum::to_units(double(value));
        ++count;
    }
    void add(const Vec3f& value) const { add({value[0], value[1], value[2]}); }
};

void add_attribute(const RenderContext& context, const FilmLayer& layer, size_t layer_index,
                   size_t layer_count, const SurfacePoint& hit, uint32_t sample, const LayerSums& to) {
    const AttributeValues* attribute = context.layer_attributes[hit.geometry * layer_count + layer_index];
    if (!attribute) return;
    // Discrete values must not be averaged: a pixel keeps the first one.
    if (layer.discrete && to.count > 0) return;
    const std::array<float, 4> values = value_at(context, *attribute, hit);
    for (uint32_t c = 0; c < layer.channels; ++c) to.sums[c] += ValueSum::to_units(double(values[c]));
    to.count = layer.discrete ? 1 + sample : to.count + 1;
}

} // namespace

void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, uint32_t sample,
                Film& film, size_t pixel) {
    const bool on_strand = first.found && first.point.shape != PointShape::triangle;
    for (size_t i = 0; i < film.layers.size(); ++i) {
        const FilmLayer& layer = film.layers[i];
        const LayerSums to{film.sums.data() + pixel * film.stride + layer.sums_offset,
                           film.counts[pixel * film.layers.size() + i]};
        switch (layer.kind) {
        case LayerKind::beauty:
            to.add(radiance);
            break;
        case LayerKind::variance:
            to.add(radiance);
            for (int c = 0; c < 3; ++c)
                to.sums[c + 3] += SquareSum::to_units(double(radiance[c]) * double(radiance[c]));
            break;
        case LayerKind::alpha:
            to.add({first.found ? 1.0F : 0.0F});
            break;
        case LayerKind::albedo:
            to.add(first.albedo);
            break;
        case LayerKind::normal:
            to.add(first.normal);
            break;
        case LayerKind::depth:
            if (first.found) to.add({first.point.distance});
            break;
        case LayerKind::strand_u:
            if (on_strand) to.add({first.point.strand_u});
            break;
        case LayerKind::attribute:
            if (first.found) add_attribute(context, layer, i, film.layers.size(), first.point, sample, to);
            break;
        }
    }
}

} // namespace marram
