// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/math/params.h"

#include <string>
#include <string_view>

namespace marram {

// As a string of TOML: in quotes, with escapes.
std::string quoted_text(std::string_view text);

// A value as text of a scene file, which read_value() reads as the same value: 4, "text", [1, 2],
// { keys = [[1, 2], [24, 9]] }. scene: the file; paths are relative to it.
std::string value_text(const ParamValue& value, const std::string& scene);

} // namespace marram
