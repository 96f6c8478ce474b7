// SPDX-License-Identifier: Apache-2.0
// Names in files that other programs read.
#pragma once

#include <set>
#include <string>

namespace marram {

// A name that USD and PLY take as an identifier and OBJ as one word, and that nobody else has.
std::string unique_name(const std::string& name, const char* fallback, std::set<std::string>& taken);

} // namespace marram
