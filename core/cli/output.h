// SPDX-License-Identifier: Apache-2.0
// What the program prints. Messages (warnings, errors, progress) go to standard error, results (names of
// files, texts that were asked for) to standard output. Neither ends a run: a frame is worth more than a line
// about it.
#pragma once

#include <fmt/format.h>

#include <string_view>
#include <vector>

namespace marram {

struct Problem;

// Opens those of the descriptors 0, 1 and 2 that are closed. Otherwise the next file that the program opens
// gets the number, and what is printed ends up in it. Uses only system calls, so it may run before all
// initialisers.
void open_standard_streams();

// Writes to standard error. A failed write (a full disk, a closed pipe) is ignored.
void write_message(std::string_view text);

// Writes to standard output. A failed write is reported by check_results() at the end.
void write_result(std::string_view text);

template <typename... T>
void print_message(fmt::format_string<T...> format, T&&... values) {
    write_message(fmt::format(format, std::forward<T>(values)...));
}

template <typename... T>
void print_result(fmt::format_string<T...> format, T&&... values) {
    write_result(fmt::format(format, std::forward<T>(values)...));
}

// One line each. Of more than 50 only the first are printed, and how many more there are.
void print_problems(const std::vector<Problem>& problems);

// Call it before the first result: a closed pipe becomes a failed write instead of the end of the process.
void keep_running_without_reader();

// Passes on what write_result() has buffered: an interrupt may end the process before a later flush.
void flush_results();

// Flushes. Throws InputError if a result could not be written. If its reader has closed the pipe, as `head`
// does, the process ends by SIGPIPE, as shells expect. Call it once all files are written.
void check_results();

} // namespace marram
