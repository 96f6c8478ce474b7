// SPDX-License-Identifier: Apache-2.0
#include "core/scene/param_types.h"

#include "core/scene/suggest.h"
#include "core/scene/values.h"
#include "core/scene/words.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fmt/format.h>
#include <limits>

namespace marram {
namespace {

bool wrong(const toml::node& node, const ParamSpec& spec, const std::string& label, Reading& reading) {
    reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                   "give " + wanted(spec));
    return false;
}

bool reject(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue&,
            Reading& reading) {
    return wrong(node, spec, label, reading);
}

bool read_integer(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                  Reading& reading) {
    const auto* integer = node.as_integer();
    if (!integer) return wrong(node, spec, label, reading);
    const int64_t number = integer->get();
    const bool fits =
        number >= std::numeric_limits<int32_t>::min() && number <= std::numeric_limits<int32_t>::max();
    const double real = static_cast<double>(number);
    if (real < spec.minimum || real > spec.maximum) return wrong(node, spec, label, reading);
    if (!fits) {
        reading.report(place_of(node, reading),
                       fmt::format("{} is {}, which no 32-bit integer can hold", label, number),
                       "give a smaller number");
        return false;
    }
    value.numbers = {real};
    return true;
}

bool read_boolean(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                  Reading& reading) {
    if (!node.is_boolean()) return wrong(node, spec, label, reading);
    value.numbers = {node.as_boolean()->get() ? 1.0 : 0.0};
    return true;
}

bool read_real(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading) {
    const auto number = read_number(node, spec.minimum, spec.maximum, label, "give " + wanted(spec), reading);
    if (number) value.numbers = {*number};
    return number.has_value();
}

template <size_t count, bool scalar>
bool read_vector(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading) {
    return read_numbers(node, spec, count, scalar, label, value.numbers, reading);
}

bool read_range(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                Reading& reading) {
    if (!read_numbers(node, spec, 2, true, label, value.numbers, reading)) return false;
    if (value.numbers[0] <= value.numbers[1]) return true;
    reading.report(place_of(node, reading),
                   fmt::format("{} runs from {} down to {}", label, value.numbers[0], value.numbers[1]),
                   "give the lower number first");
    return false;
}

bool read_text(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading) {
    if (!node.is_string()) return wrong(node, spec, label, reading);
    value.text = node.as_string()->get();
    return true;
}

bool read_texts(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                Reading& reading) {
    if (!node.is_array()) return wrong(node, spec, label, reading);
    for (const toml::node& item : *node.as_array()) {
        if (!item.is_string()) return wrong(item, spec, "a part of " + label, reading);
        value.texts.push_back(item.as_string()->get());
    }
    return true;
}

bool read_reference(const toml::node& node, const ParamSpec& spec, const std::string& label,
                    ParamValue& value, Reading& reading) {
    const toml::array* names = spec.each ? node.as_array() : nullptr;
    if (!names) return read_text(node, spec, label, value, reading);
    if (names->empty()) return wrong(node, spec, label, reading);
    if (!read_texts(node, spec, label, value, reading)) return false;
    std::vector<std::string> sorted = value.texts;
    std::ranges::sort(sorted);
    if (const auto twice = std::ranges::adjacent_find(sorted); twice != sorted.end()) {
        reading.report(place_of(node, reading), fmt::format("{} names {} twice", label, in_quotes(*twice)),
                       "name each once");
        return false;
    }
    value.text = value.texts.front();
    return true;
}

bool read_one_choice(const toml::node& node, const ParamSpec& spec, const std::string& label,
                     ParamValue& value, Reading& reading) {
    return read_choice(node, split(spec.choices, '|'), label, value.text, reading);
}

// "mesh|procedural" -> "a mesh or a procedural"; "curves" has no singular.
std::string kinds(const std::string& choices) {
    std::string text;
    for (const std::string& kind : split(choices, '|'))
        text += (text.empty() ? "" : " or ") + ((kind == "curves" ? "" : "a ") + kind);
    return text;
}

std::string any_or(const std::string& limits, const char* any) { return limits.empty() ? any : limits; }

// [ParamType]
constexpr std::array rows = {
    ParamTypeRow{ParamType::boolean, "boolean", "boolean", false, read_boolean,
                 [](const ParamSpec&) -> std::string { return "true or false"; }},
    ParamTypeRow{ParamType::integer, "integer", "integer", false, read_integer,
                 [](const ParamSpec& spec) { return "a whole number" + bounds(spec); }},
    ParamTypeRow{ParamType::number, "number", "number", false, read_real,
                 [](const ParamSpec& spec) { return "a number" + bounds(spec); }},
    ParamTypeRow{ParamType::vec2, "vec2", "[a, b]", false, read_vector<2, false>,
                 [](const ParamSpec& spec) { return "[a, b], two numbers" + bounds(spec); }},
    ParamTypeRow{ParamType::vec3, "vec3", "[x, y, z]", false, read_vector<3, false>,
                 [](const ParamSpec& spec) { return "[x, y, z], three numbers" + bounds(spec); }},
    ParamTypeRow{
        ParamType::range, "range", "range", false, read_range,
        [](const ParamSpec& spec) { return "[low, high] or one number," + any_or(bounds(spec), " any"); }},
    ParamTypeRow{
        ParamType::color, "color", "color", false, read_vector<3, true>,
        [](const ParamSpec& spec) { return "[r, g, b] or one number for a grey, linear," + bounds(spec); }},
    ParamTypeRow{ParamType::text, "text", "text", true, read_text,
                 [](const ParamSpec&) -> std::string { return "a text in quotes"; }},
    ParamTypeRow{ParamType::choice, "choice", "choice", true, read_one_choice,
                 [](const ParamSpec& spec) {
                     return "one of " + listed(split(spec.choices, '|'), 100) + " in quotes";
                 }},
    ParamTypeRow{ParamType::ramp, "ramp", "ramp", false, read_ramp,
                 [](const ParamSpec&) -> std::string {
                     return "[[position, value], ...] or { knots = [[position, value], ...], interpolation "
                            "= \"linear\" }";
                 }},
    ParamTypeRow{ParamType::file, "", "file", true, read_path,
                 [](const ParamSpec&) -> std::string { return "the path of a file, in quotes"; }},
    ParamTypeRow{ParamType::image, "image", "image", true, read_path,
                 [](const ParamSpec&) -> std::string { return "the path of an image, in quotes"; }},
    ParamTypeRow{ParamType::reference, "reference", "name of a", true, read_reference,
                 [](const ParamSpec& spec) {
                     return fmt::format("the name of {}, in quotes{}", kinds(spec.choices),
                                        spec.each ? ", or a list of such names" : "");
                 }},
    ParamTypeRow{ParamType::texts, "", "list of text", false, read_texts,
                 [](const ParamSpec&) -> std::string { return "a list of texts, [\"a\", \"b\"]"; }},
    ParamTypeRow{ParamType::keys, "keys", "transform", false, read_keys,
                 [](const ParamSpec&) -> std::string {
                     return "{ translate = [x, y, z], rotate = [x, y, z], scale = 1 } or { keys = [{ frame "
                            "= 1, ... }, ...] }";
                 }},
    ParamTypeRow{ParamType::points, "", "list of [x, y, z]", false, read_points,
                 [](const ParamSpec& spec) {
                     const std::string limits = bounds(spec);
                     return "[[x, y, z], ...]," + (limits.empty() ? " any numbers" : " numbers" + limits);
                 }},
    ParamTypeRow{
        ParamType::table, "table", "table", true, read_path,
        [](const ParamSpec&) -> std::string { return "the path of a CSV file of numbers, in quotes"; }},
    ParamTypeRow{
        ParamType::volume, "volume", "volume", false, read_volume,
        [](const ParamSpec&) -> std::string {
            return "the path of an OpenVDB file, in quotes, or { file = \"a.####.vdb\", frames = [1, 48], "
                   "grid = \"vel\" }";
        }},
    ParamTypeRow{ParamType::unavailable, "unavailable", "unavailable", false,
                 reject, // rejected by name before its value is read
                 [](const ParamSpec&) -> std::string { return "nothing"; }},
};

constexpr bool in_order() {
    for (size_t i = 0; i < rows.size(); ++i)
        if (rows[i].type != ParamType(i)) return false;
    return rows.size() == size_t(ParamType::unavailable) + 1;
}
static_assert(in_order(), "a type of parameters has no row, or not in the order of ParamType");

} // namespace

const ParamTypeRow& row_of(ParamType type) { return rows[size_t(type)]; }

std::optional<ParamType> param_type_of(std::string_view name) {
    const auto found = std::ranges::find(rows, name, &ParamTypeRow::contract_name);
    if (name.empty() || found == rows.end()) return {};
    return found->type;
}

std::string wanted(const ParamSpec& spec) { return row_of(spec.type).wanted(spec); }

} // namespace marram
