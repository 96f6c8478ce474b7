// SPDX-License-Identifier: Apache-2.0
// File names of image sequences.
#pragma once

#include <string>

namespace marram {

// Replaces the run of # in the output's name by the frame number: "####" becomes "0007" at frame 7,
// "0007.25" at 7.25, "-0003" at -3.
std::string numbered(const std::string& output, double frame);

} // namespace marram
