// SPDX-License-Identifier: Apache-2.0
// TOML node -> ParamValue, checked against its declaration. `label` is how messages call the value:
// "film.samples", "mesh.hill.size". Whatever is wrong is reported with the place of the node that is wrong.
//
// To add a parameter type: a ParamType in core/math/params.h, a case in read_value() and in wanted(), a
// broken file.
#pragma once

#include "core/scene/reading.h"

namespace marram {

// Nothing when a mistake has been reported.
std::optional<ParamValue> read_value(const toml::node& node, const ParamSpec& spec, const std::string& label,
                                     Reading& reading);

// The declared default, read as a user's value would be; "" and "none" have none. Text-like types may leave
// out quotes. A default that is no valid value (of a procedural library, say) is reported as the mistake of
// its owner.
std::optional<ParamValue> default_value(const ParamSpec& spec, const std::string& label, const Place& table,
                                        Reading& reading);

// The parts that ramps and transforms share.

// A finite number within the limits; `fix` says what is wanted.
std::optional<double> read_number(const toml::node& node, double minimum, double maximum,
                                  const std::string& label, const std::string& fix, Reading& reading);

// Exactly `count` numbers, appended to `numbers`. A single number stands for all of them where `scalar` is
// set.
bool read_numbers(const toml::node& node, const ParamSpec& spec, size_t count, bool scalar,
                  const std::string& label, std::vector<double>& numbers, Reading& reading);

// Text that is one of `choices`.
bool read_choice(const toml::node& node, std::span<const std::string> choices, const std::string& label,
                 std::string& text, Reading& reading);

// Reports every key of `table` that is none of `known`; true when there is none.
bool only_keys(const toml::table& table, std::span<const std::string> known, const std::string& label,
               Reading& reading);

bool read_ramp(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);
bool read_keys(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);
bool read_points(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading);
bool read_path(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);

} // namespace marram
