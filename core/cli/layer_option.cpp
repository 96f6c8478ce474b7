// SPDX-License-Identifier: Apache-2.0
#include "core/cli/layer_option.h"

#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace marram {
namespace {

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

} // namespace marram
