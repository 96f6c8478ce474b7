// SPDX-License-Identifier: Apache-2.0
#include "core/scene/values.h"
#include "core/scene/param_types.h"
#include "core/scene/parse.h"
#include "core/scene/suggest.h"
#include "core/scene/words.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <limits>

namespace marram {

toml::table value_table(const ParamSpec& spec, std::string_view given) {
    constexpr std::string_view blanks = " \t\r\n";
    const size_t first = std::min(given.find_first_not_of(blanks), given.size());
    const std::string_view text = given.substr(first, given.find_last_not_of(blanks) + 1 - first);
    const bool bare = row_of(spec.type).is_text && text.find_first_of("\"'") != 0;
    return parse_value(bare ? fmt::format("'''{}'''", text) : std::string(text), "");
}

std::optional<double> read_number(const toml::node& node, double minimum, double maximum,
                                  const std::string& label, const std::string& fix, Reading& reading) {
    const std::optional<double> number = node.is_number() ? node.value<double>() : std::nullopt;
    if (number && std::isfinite(*number) && *number >= minimum && *number <= maximum) return number;
    reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)), fix);
    return {};
}

bool read_numbers(const toml::node& node, const ParamSpec& spec, size_t count, bool scalar,
                  const std::string& label, std::vector<double>& numbers, Reading& reading) {
    const double minimum = spec.type == ParamType::color ? std::max(spec.minimum, 0.0) : spec.minimum;
    const std::string fix = "give " + wanted(spec);
    if (scalar && node.is_number()) {
        const std::optional<double> number = read_number(node, minimum, spec.maximum, label, fix, reading);
        if (number) numbers.insert(numbers.end(), count, *number);
        return number.has_value();
    }
    const toml::array* array = node.as_array();
    if (!array || array->size() != count) {
        reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)), fix);
        return false;
    }
    bool good = true;
    for (size_t i = 0; i < count; ++i) {
        const std::string part = fmt::format("number {} of {}", i + 1, label);
        const auto number = read_number(*array->get(i), minimum, spec.maximum, part, fix, reading);
        numbers.push_back(number.value_or(0.0));
        good = good && number.has_value();
    }
    return good;
}

bool read_choice(const toml::node& node, std::span<const std::string> choices, const std::string& label,
                 std::string& text, Reading& reading) {
    if (node.is_string()) {
        text = node.as_string()->get();
        for (const std::string& choice : choices)
            if (choice == text) return true;
    }
    reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                   node.is_string() ? hint(text, choices, "choice", all_words)
                                    : "give one of " + listed(choices, all_words) + " in quotes");
    return false;
}

bool only_keys(const toml::table& table, std::span<const std::string> known, const std::string& label,
               Reading& reading) {
    bool good = true;
    for (const auto& [key, node] : table) {
        bool is_known = false;
        for (const std::string& name : known) is_known = is_known || name == key.str();
        if (is_known) continue;
        reading.report(place_of(key.source(), reading),
                       fmt::format("{}.{} is unknown", label, clean(key.str())),
                       hint(key.str(), known, "key"));
        good = false;
    }
    return good;
}

std::optional<ParamValue> read_value(const toml::node& node, const ParamSpec& spec, const std::string& label,
                                     Reading& reading) {
    ParamValue value;
    value.spec = &spec;
    value.place = place_of(node, reading);
    value.given = true;
    const toml::table* table = node.as_table();
    if (table && table->contains("keys") && spec.type != ParamType::keys) {
        if (spec.keyable) {
            if (!read_keyframes(*table, spec, label, value, reading)) return {};
            return value;
        }
        reading.report(place_of(*table->get("keys"), reading),
                       fmt::format("{} has keys, and is the same at all frames", label),
                       "give one value, " + wanted(spec) + "; `marram info` marks what can have keys");
        return {};
    }
    if (table && spec.keyable && spec.type != ParamType::ramp) {
        reading.report(value.place, fmt::format("{} is a table without keys", label),
                       "give " + wanted(spec) + ", or { keys = [[frame, value], ...] }");
        return {};
    }
    if (!row_of(spec.type).read(node, spec, label, value, reading)) return {};
    return value;
}

std::optional<ParamValue> default_value(const ParamSpec& spec, const std::string& label, const Place& table,
                                        Reading& reading) {
    auto [entry, is_new] = reading.defaults.try_emplace(&spec);
    if (is_new) {
        Reading aside;
        aside.file = reading.file;
        const toml::table parsed = value_table(spec, spec.initial);
        if (const toml::node* node = parsed.get("value"))
            entry->second = read_value(*node, spec, label, aside);
        if (!entry->second)
            reading.report(
                table,
                fmt::format("the default of {}, {}, is no valid value", label, in_quotes(spec.initial)),
                "report it to the library's author, or give a value (" + wanted(spec) + ")");
    }
    if (!entry->second) return {};
    ParamValue value = *entry->second;
    value.place = table;
    value.given = false;
    return value;
}

} // namespace marram
