// SPDX-License-Identifier: Apache-2.0
// Man pages in roff, with the macros of man(7).
#pragma once

#include "core/manual/command_text.h"

#include <string>

namespace marram {

std::string program_page(const ProgramText& text);
std::string command_page(const ProgramText& text, const CommandText& command);

} // namespace marram
