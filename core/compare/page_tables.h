// SPDX-License-Identifier: Apache-2.0
// The tables of a page of two pictures: every number beside its limit, and what the files say of themselves.
#pragma once

#include "core/compare/compare_page.h"

#include <string>

namespace marram::page {

std::string numbers(const Comparison& comparison, const Picture& reference);
std::string metadata(const ComparedFile& a, const ComparedFile& b);

} // namespace marram::page
