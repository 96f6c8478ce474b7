// SPDX-License-Identifier: Apache-2.0
// What the program prints. Messages (warnings, errors, progress) go to standard error, results (names of
// files, texts that were asked for) to standard output. Neither ends a run: a frame is worth more than a line
// about it.
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct Problem;

enum class LogFormat { text, time, json };
enum class LogLevel { info, warning, error };

// How messages are written from this call on: as lines of text, as such lines with the time before them, or
// as one JSON object a line: time (RFC 3339, UTC), level, id, file, line, column, and what and fix of a
// mistake or warning, else text. A place that a message has not is "" or 0; without an id of its own it has
// "option", "line" (of a file), "file" or "program", by its place.
void set_log_format(LogFormat format);
LogFormat log_format();

// The time of a message: "2026-11-30T15:56:58.123Z".
std::string time_text();

// Opens those of the descriptors 0, 1 and 2 that are closed. Otherwise the next file that the program opens
// gets the number, and what is printed ends up in it. Uses only system calls, so it may run before all
// initialisers.
void open_standard_streams();

// Writes a message, one line without its end, to standard error. A failed write (a full disk, a closed pipe)
// is ignored. A text that begins with a place, "file:line:column: " or the name of a file that is there, has
// it in the JSON object as well.
void write_message(LogLevel level, std::string_view line);

// The same for the message of a lack of memory: nothing is allocated.
void write_error_without_memory(const char* line);

// Draws on the terminal: no message, so it has no format.
void draw(std::string_view text);

// Writes to standard output. A failed write is reported by check_results() at the end.
void write_result(std::string_view text);

// Writes what is worth knowing. The end of the line may be part of the format.
template <typename... T>
void print_message(fmt::format_string<T...> format, T&&... values) {
    write_message(LogLevel::info, fmt::format(format, std::forward<T>(values)...));
}

void print_warning(const Problem& warning);
void print_note(const Problem& note); // what is worth knowing, also while a progress line is drawn

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
