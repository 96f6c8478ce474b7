// SPDX-License-Identifier: Apache-2.0
// Descriptions of values in messages, which read "<label> is <found>: give <wanted>".
#pragma once

#include "core/scene/reading.h"

namespace marram {

std::string found(const toml::node& node); // `the text "fast"`, `2.5`, `an array`, `a table`, `true`
std::string limit(double value);           // 24, 1e8, 1e-6
std::string bounds(const ParamSpec& spec); // ` from 0 to 1 m`, ` of 0 m or more`, ` in m`, or nothing

} // namespace marram
