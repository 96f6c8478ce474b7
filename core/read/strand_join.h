// SPDX-License-Identifier: Apache-2.0
// Shared by the readers of strands: the strands of several prims as one, and those of several times alike.
#pragma once

#include "core/read/strand_file.h"

namespace marram {

inline constexpr size_t max_strand_attributes = 64; // constant ones are copied to every curve

// Appends `part`, which has the same times, to `all`, which may be empty. Attributes and widths that one of them lacks are
// 0 there: returns a line for each. place, path: of the part, for messages. Throws InputError for attributes that do not
// go together, or too many.
std::vector<std::string> join_strands(const Place& place, const std::string& path, StrandFile part,
                                      StrandFile& all);

// Gives all the attributes that any of them has, in the same order and at the same rate; 0 where one lacks
// them.
void match_attributes(std::vector<StrandFile>& takes);

} // namespace marram
