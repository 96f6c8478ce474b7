// SPDX-License-Identifier: Apache-2.0
#include "core/shot/layer_picture.h"

#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <charconv>
#include <cmath>
#include <limits>

namespace marram {
namespace {

const BuiltInLayer* built_in(const std::string& name) {
    const auto known = std::ranges::find(built_in_layers(), name, &BuiltInLayer::name);
    return known == built_in_layers().end() ? nullptr : &*known;
}

ValueRange range_of(const LayerPicture& picture) {
    if (picture.range) return *picture.range;
    const std::optional<ValueRange> natural = natural_range(picture.layer);
    assert(natural);
    return natural.value_or(ValueRange{});
}

// For example "0-20", "-1-1", "20-0".
std::optional<ValueRange> parse_value_range(const std::string& text) {
    ValueRange range;
    const char* end = text.data() + text.size();
    const auto black = std::from_chars(text.data(), end, range.black);
    if (black.ec != std::errc{} || black.ptr == end || *black.ptr != '-') return {};
    const auto white = std::from_chars(black.ptr + 1, end, range.white);
    const bool good = white.ec == std::errc{} && white.ptr == end && std::isfinite(range.black) &&
                      std::isfinite(range.white - range.black) && range.black != range.white;
    return good ? std::optional(range) : std::nullopt;
}

} // namespace

LayerPicture parse_layer_picture(const std::string& text) {
    const size_t equals = std::min(text.find('='), text.size());
    const std::string layer = text.substr(0, equals);
    const auto refuse = [&](size_t at, const std::string& what, const std::string& fix) {
        return InputError({"--png " + text, 1, int(at) + 1}, what, fix);
    };
    if (equals + 1 >= text.size())
        throw refuse(text.size(), "the file is missing",
                     "write LAYER:BLACK-WHITE=FILE, such as depth:0-20=depth.png");
    LayerPicture picture{layer, text.substr(equals + 1), {}};
    if (const size_t colon = layer.rfind(':'); colon != std::string::npos) {
        picture.layer = layer.substr(0, colon);
        const std::string range = layer.substr(colon + 1);
        picture.range = parse_value_range(range);
        if (!picture.range)
            throw refuse(colon + 1, fmt::format("'{}' is no range of values", range),
                         "give two different numbers, those of black and of white, such as 0-20 or -1-1");
    }
    if (picture.layer.empty()) throw refuse(0, "the layer is missing", "see `marram info layers`");
    return picture;
}

std::optional<ValueRange> natural_range(const std::string& layer) {
    if (const BuiltInLayer* known = built_in(layer))
        return known->range ? std::optional(ValueRange{known->range->first, known->range->second})
                            : std::nullopt;
    if (layer == "gust" || layer == "shield") return ValueRange{0.0, 1.0}; // gusts that overlap may exceed it
    return std::nullopt;
}

std::string names_of_extra_layers() {
    std::vector<std::string_view> names;
    for (const BuiltInLayer& layer : built_in_layers())
        if (!layer.always) names.push_back(layer.name);
    return fmt::format("{}", fmt::join(names, ", "));
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
    std::vector<float> values = layer.values;
    if (layer.kind == LayerKind::beauty || layer.kind == LayerKind::albedo) {
        for (float& value : values)
            value = float((double(value) - range.black) / (range.white - range.black));
        write_png(picture.file, width, height, 3, values.data(),
                  layer.kind == LayerKind::beauty ? exposure : 0.0, metadata);
        return;
    }
    if (layer.kind == LayerKind::depth)
        std::ranges::replace(values, 0.0F, std::numeric_limits<float>::infinity());
    write_range_png(picture.file, width, height, int(layer.channels), values.data(), range, metadata);
}

} // namespace marram
