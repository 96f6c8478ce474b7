// SPDX-License-Identifier: Apache-2.0
// File names of sequences. The # that stand for a frame's number belong to the file's name: in a folder's
// name they mean nothing.
#pragma once

#include <string>

namespace marram {

// Whether the file's name has a # for the frame's number.
bool has_frame_mark(const std::string& path);

// Replaces the first run of # in the file's name by the frame's number: "####" becomes "0007" at frame 7, "0007.25" at
// 7.25, "-0003" at -3.
std::string numbered(const std::string& path, double frame);

} // namespace marram
