// SPDX-License-Identifier: Apache-2.0
// Tables of the comparison page: all values with their limits, and the metadata of the files.
#pragma once

#include "core/compare/compare_page.h"

#include <string>

namespace marram::page {

std::string numbers(const Comparison& comparison, const Picture& reference);
std::string metadata(const ComparedFile& a, const ComparedFile& b);

} // namespace marram::page
