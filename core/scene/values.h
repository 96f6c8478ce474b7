// SPDX-License-Identifier: Apache-2.0
// Converts a TOML node to a ParamValue and checks it against its declaration. `label` names the value in
// messages: "film.samples", "mesh.hill.size". Mistakes are reported with the place of the wrong node.
#pragma once

#include "core/scene/reading.h"

namespace marram {

// nullopt after a mistake has been reported.
std::optional<ParamValue> read_value(const toml::node& node, const ParamSpec& spec, const std::string& label,
                                     Reading& reading);

// Parses the text of a value of this parameter into a table whose only key is `value`; empty if it is no value.
// Blanks around it are ignored. Text-like types may leave out quotes.
toml::table value_table(const ParamSpec& spec, std::string_view text);

// The declared default, parsed like a user's value. "" and "none" mean that there is no default. An invalid
// default, for example of a procedural library, is reported as the mistake of its owner.
std::optional<ParamValue> default_value(const ParamSpec& spec, const std::string& label, const Place& table,
                                        Reading& reading);

// The functions below are shared by ramps and transforms.

// A finite number within the limits; `fix` is the remedy in the message.
std::optional<double> read_number(const toml::node& node, double minimum, double maximum,
                                  const std::string& label, const std::string& fix, Reading& reading);

// Reads exactly `count` numbers and appends them to `numbers`. If `scalar` is set, a single number stands for
// all of them.
bool read_numbers(const toml::node& node, const ParamSpec& spec, size_t count, bool scalar,
                  const std::string& label, std::vector<double>& numbers, Reading& reading);

// Reads a text that must be one of `choices`.
bool read_choice(const toml::node& node, std::span<const std::string> choices, const std::string& label,
                 std::string& text, Reading& reading);

// Reports every key of `table` that is not in `known`. Returns true if there is none.
bool only_keys(const toml::table& table, std::span<const std::string> known, const std::string& label,
               Reading& reading);

bool read_ramp(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);
bool read_keys(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);
// Reads { keys = [[frame, value], ...], interpolation = ... } of a keyable parameter.
bool read_keyframes(const toml::table& table, const ParamSpec& spec, const std::string& label,
                    ParamValue& value, Reading& reading);
bool read_points(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading);
bool read_path(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
               Reading& reading);
bool read_volume(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading);

} // namespace marram
