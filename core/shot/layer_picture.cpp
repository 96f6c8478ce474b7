// SPDX-License-Identifier: Apache-2.0
#include "core/shot/layer_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <limits>

namespace marram {
namespace {

LayerKind kind_of_layer(const std::string& name) {
    const auto known = std::ranges::find(built_in_layers(), name, &BuiltInLayer::name);
    return known == built_in_layers().end() ? LayerKind::attribute : known->kind;
}

ValueRange range_of(const LayerPicture& picture) {
    if (picture.range) return *picture.range;
    const std::optional<ValueRange> natural = natural_range(picture.layer);
    assert(natural);
    return natural.value_or(ValueRange{});
}

} // namespace

std::optional<ValueRange> natural_range(const std::string& layer) {
    switch (kind_of_layer(layer)) {
    case LayerKind::beauty:
    case LayerKind::albedo:
    case LayerKind::alpha:
    case LayerKind::strand_u:
        return ValueRange{0.0, 1.0};
    case LayerKind::normal:
        return ValueRange{-1.0, 1.0};
    case LayerKind::variance:
    case LayerKind::depth:
    case LayerKind::attribute:
        break;
    }
    return std::nullopt;
}

std::string layer_text(const LayerPicture& picture) {
    const ValueRange range = range_of(picture);
    return fmt::format("{} {} {}", picture.layer, range.black, range.white);
}

void save_layer_picture(const LayerPicture& picture, const Film& film, double exposure,
                        const std::vector<Metadata>& metadata) {
    const FilmLayer& layer = *find_layer(film, picture.layer);
    const int width = int(film.width), height = int(film.height);
    const ValueRange range = range_of(picture);
    std::vector<float> pixels = layer.pixels;
    if (layer.kind == LayerKind::beauty || layer.kind == LayerKind::albedo) {
        for (float& value : pixels)
            value = float((double(value) - range.black) / (range.white - range.black));
        write_png(picture.file, width, height, 3, pixels.data(),
                  layer.kind == LayerKind::beauty ? exposure : 0.0, metadata);
        return;
    }
    if (layer.kind == LayerKind::depth)
        std::ranges::replace(pixels, 0.0F, std::numeric_limits<float>::infinity());
    write_range_png(picture.file, width, height, int(layer.channels), pixels.data(), range, metadata);
}

} // namespace marram
