// SPDX-License-Identifier: Apache-2.0
// Names in exported files.
#pragma once

#include <set>
#include <string>

namespace marram {

// A name that is an identifier in USD and PLY and one word in OBJ, and that is not in `taken`.
std::string unique_name(const std::string& name, const char* fallback, std::set<std::string>& taken);

} // namespace marram
