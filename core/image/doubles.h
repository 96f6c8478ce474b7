// SPDX-License-Identifier: Apache-2.0
// Pictures of doubles, bit for bit, as TIFF: for what a program means to read back itself, yet in a format that others
// know too. Not compressed: on two cores ZIP at its fastest takes three times as long to write 1920 x 1080 pixels of 11
// channels (2 s instead of 0.6 s) to save two thirds of the room, and who pressed Ctrl-C waits for it.
#pragma once

#include <functional>
#include <string>

namespace marram {

struct DoublesHeader {
    int width = 0, height = 0, channels = 0;
    std::string description; // TIFF's ImageDescription
};

// `row(y, values)` fills or takes a row's width * channels values, channels interleaved; rows come in order from the top.
// Written whole or not at all (core/image/atomic_file.h). All throw InputError that names the file.
void write_doubles(const std::string& path, const DoublesHeader& header,
                   const std::function<void(int, double*)>& row);

// Of any picture: of one that is none of doubles it says 0 channels.
DoublesHeader read_doubles_header(const std::string& path);

// The file's header must be `header` still. What was taken before an error is worth nothing.
void read_doubles(const std::string& path, const DoublesHeader& header,
                  const std::function<void(int, const double*)>& row);

} // namespace marram
