// SPDX-License-Identifier: Apache-2.0
#include "core/scene/value_text.h"

#include "core/scene/param_types.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <span>

namespace marram {
namespace {

using Numbers = std::span<const double>;

std::string list_text(Numbers numbers) { return fmt::format("[{}]", fmt::join(numbers, ", ")); }

// [[a, b], [c, d]]: lists of `each` numbers.
std::string lists_text(Numbers numbers, size_t each) {
    std::string text;
    for (size_t i = 0; i + each <= numbers.size(); i += each)
        text += (i > 0 ? ", " : "") + list_text(numbers.subspan(i, each));
    return "[" + text + "]";
}

std::string quoted_list(const std::vector<std::string>& texts) {
    std::string list;
    for (const std::string& text : texts) list += (list.empty() ? "" : ", ") + quoted_text(text);
    return "[" + list + "]";
}

// Of a keyed transform: the parts that are not the identity.
std::string pose_text(Numbers key, bool with_frame) {
    std::string text = with_frame ? fmt::format("frame = {}", key[0]) : "";
    const auto add = [&](const char* name, Numbers part, double rest) {
        if (std::ranges::all_of(part, [&](double x) { return x == rest; })) return;
        text += fmt::format("{}{} = {}", text.empty() ? "" : ", ", name, list_text(part));
    };
    add("translate", key.subspan(1, 3), 0.0);
    add("rotate", key.subspan(4, 3), 0.0);
    add("scale", key.subspan(7, 3), 1.0);
    return text.empty() ? "{}" : "{ " + text + " }";
}

std::string transform_text(const ParamValue& value) {
    constexpr size_t each = 10;
    const Numbers numbers = value.numbers;
    if (numbers.size() <= each) return pose_text(numbers, false);
    std::string keys;
    for (size_t i = 0; i + each <= numbers.size(); i += each)
        keys += (i > 0 ? ", " : "") + pose_text(numbers.subspan(i, each), true);
    const bool smooth = value.text != "linear";
    return fmt::format("{{ keys = [{}]{} }}", keys,
                       smooth ? ", interpolation = " + quoted_text(value.text) : "");
}

std::string ramp_text(Numbers numbers, const std::string& interpolation) {
    const std::string knots = lists_text(numbers, 2);
    return interpolation == "linear"
               ? knots
               : fmt::format("{{ knots = {}, interpolation = {} }}", knots, quoted_text(interpolation));
}

std::string number_text(const ParamValue& value, Numbers numbers) {
    switch (value.spec->type) {
    case ParamType::boolean:
        return numbers[0] != 0.0 ? "true" : "false";
    case ParamType::integer:
    case ParamType::number:
        return fmt::format("{}", numbers[0]);
    case ParamType::ramp:
        return ramp_text(numbers, value.text);
    default:
        return list_text(numbers);
    }
}

std::string keyed_text(const ParamValue& value) {
    const Keyframes& keys = *value.keys;
    std::string list;
    for (size_t i = 0; i < keys.count(); ++i)
        list += fmt::format("{}[{}, {}]", i > 0 ? ", " : "", keys.frames[i], number_text(value, keys.key(i)));
    const bool linear = keys.interpolation == KeyInterpolation::linear;
    return fmt::format("{{ keys = [{}]{} }}", list,
                       linear ? "" : fmt::format(", interpolation = \"{}\"", name_of(keys.interpolation)));
}

} // namespace

std::string quoted_text(std::string_view text) {
    std::string quoted = "\"";
    for (const char c : text)
        if (c == '"' || c == '\\')
            quoted += std::string("\\") + c;
        else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
            quoted += fmt::format("\\u{:04x}", unsigned(c));
        else
            quoted += c;
    return quoted + '"';
}

std::string value_text(const ParamValue& value, const std::string& scene) {
    namespace fs = std::filesystem;
    if (value.keys) return keyed_text(value);
    switch (value.spec->type) {
    case ParamType::text:
    case ParamType::choice:
        return quoted_text(value.text);
    case ParamType::reference:
        return value.texts.empty() ? quoted_text(value.text) : quoted_list(value.texts);
    case ParamType::texts:
        return quoted_list(value.texts);
    case ParamType::file:
    case ParamType::image:
    case ParamType::table: {
        const fs::path folder = fs::path(scene).parent_path();
        return quoted_text(fs::path(value.text).lexically_relative(folder.empty() ? "." : folder).string());
    }
    case ParamType::keys:
        return transform_text(value);
    case ParamType::points:
        return lists_text(value.numbers, 3);
    case ParamType::unavailable:
        return "";
    default:
        return number_text(value, value.numbers);
    }
}

} // namespace marram
