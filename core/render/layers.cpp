// SPDX-License-Identifier: Apache-2.0
#include "core/render/layers.h"

namespace marram {

namespace {

void add(const double* values, uint32_t channels, double* sums) {
    for (uint32_t c = 0; c < channels; ++c) sums[c] += values[c];
    sums[channels] += 1.0;
}

void add(const Vec3f& color, double* sums) {
    for (int c = 0; c < 3; ++c) sums[c] += static_cast<double>(color[c]);
    sums[3] += 1.0;
}

void add(float value, double* sums) {
    sums[0] += static_cast<double>(value);
    sums[1] += 1.0;
}

void add_attribute(const RenderContext& context, const FilmLayer& layer, size_t layer_index,
                   size_t layer_count, const SurfacePoint& hit, double* sums) {
    const AttributeValues* attribute = context.layer_attributes[hit.geometry * layer_count + layer_index];
    if (!attribute) return;
    // Discrete values must not be averaged: a pixel keeps the first one.
    if (attribute->discrete && sums[layer.channels] > 0.0) return;
    const std::array<float, 4> values = value_at(context, *attribute, hit);
    const std::array<double, 4> wide = {values[0], values[1], values[2], values[3]};
    add(wide.data(), layer.channels, sums);
}

} // namespace

void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, const Film& film,
                double* pixel_sums) {
    const bool on_strand = first.found && first.point.shape != PointShape::triangle;
    for (size_t i = 0; i < film.layers.size(); ++i) {
        const FilmLayer& layer = film.layers[i];
        double* sums = pixel_sums + layer.sums_offset;
        switch (layer.kind) {
        case LayerKind::beauty:
            add(radiance, sums);
            break;
        case LayerKind::variance:
            for (int c = 0; c < 3; ++c) {
                const auto value = static_cast<double>(radiance[c]);
                sums[c] += value;
                sums[c + 3] += value * value;
            }
            sums[6] += 1.0;
            break;
        case LayerKind::alpha:
            add(first.found ? 1.0F : 0.0F, sums);
            break;
        case LayerKind::albedo:
            add(first.albedo, sums);
            break;
        case LayerKind::normal:
            add(first.normal, sums);
            break;
        case LayerKind::depth:
            if (first.found) add(first.point.distance, sums);
            break;
        case LayerKind::strand_u:
            if (on_strand) add(first.point.strand_u, sums);
            break;
        case LayerKind::attribute:
            if (first.found) add_attribute(context, layer, i, film.layers.size(), first.point, sums);
            break;
        }
    }
}

} // namespace marram
