// SPDX-License-Identifier: Apache-2.0
#include "core/scene/words.h"
#include "core/scene/suggest.h"

#include <cmath>
#include <fmt/format.h>

namespace marram {

std::string found(const toml::node& node) {
    if (const auto* text = node.as_string()) return "the text " + in_quotes(text->get());
    if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
    if (const auto* integer = node.as_integer()) return fmt::format("{}", integer->get());
    if (const auto* number = node.as_floating_point()) {
        std::string text = fmt::format("{}", number->get());
        // Print 4.0 as it was written if an integer is wanted.
        if (std::isfinite(number->get()) && text.find_first_of(".e") == std::string::npos) text += ".0";
        return text;
    }
    if (const auto* array = node.as_array())
        return array->empty() ? "an empty list" : fmt::format("a list of {}", array->size());
    return node.is_table() ? "a table" : "a date or time";
}

std::string limit(double value) {
    if (std::fabs(value) < 1e6 && (value == 0.0 || std::fabs(value) >= 1e-3)) return fmt::format("{}", value);
    std::string text = fmt::format("{:g}", value); // 1e+08
    if (const size_t plus = text.find('+'); plus != std::string::npos) text.erase(plus, 1);
    if (const size_t zero = text.find("e0"); zero != std::string::npos) text.erase(zero + 1, 1);
    if (const size_t zero = text.find("e-0"); zero != std::string::npos) text.erase(zero + 2, 1);
    return text; // 1e8
}

std::string bounds(const ParamSpec& spec) {
    const std::string unit = spec.unit.empty() ? "" : " " + spec.unit;
    double low = spec.minimum;
    if (spec.type == ParamType::color) low = std::max(low, 0.0);
    const bool below = std::isfinite(low), above = std::isfinite(spec.maximum);
    if (below && above) return fmt::format(" from {} to {}{}", limit(low), limit(spec.maximum), unit);
    if (below) return fmt::format(" of {}{} or more", limit(low), unit);
    if (above) return fmt::format(" of {}{} or less", limit(spec.maximum), unit);
    return spec.unit.empty() ? "" : " in " + spec.unit;
}

} // namespace marram
