// SPDX-License-Identifier: Apache-2.0
// File names of sequences.
#pragma once

#include <string>

namespace marram {

// The output's name with its run of # replaced by the frame: "####" at 7 gives "0007", at 7.25 "0007.25", at -3 "-0003".
std::string numbered(const std::string& output, double frame);

} // namespace marram
