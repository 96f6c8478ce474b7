// SPDX-License-Identifier: Apache-2.0
#include "core/cli/output.h"

#include "core/cli/exit_codes.h"

#include "core/math/problem.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include <fcntl.h>
#include <unistd.h>

namespace marram {
namespace {

std::atomic<LogFormat> format_of_messages{LogFormat::text};
std::atomic<int> result_error{0};   // errno of the first failed write of a result
bool reader_may_leave = false;      // SIGPIPE was not ignored by who started the program
constexpr size_t max_problems = 50; // printed; the rest is a count

void keep_error() {
    int none = 0;
    result_error.compare_exchange_strong(none, errno != 0 ? errno : EIO);
}

using TimeText = std::array<char, 64>;

// Allocates nothing: gmtime() would read the time zone first.
TimeText now_as_text() {
    using namespace std::chrono;
    const auto now = floor<milliseconds>(system_clock::now());
    const auto day = floor<days>(now);
    const year_month_day date(day);
    const hh_mm_ss time(now - day);
    TimeText text{};
    std::snprintf(text.data(), text.size(), "%04d-%02u-%02uT%02d:%02d:%02d.%03dZ", int(date.year()),
                  unsigned(date.month()), unsigned(date.day()), int(time.hours().count()),
                  int(time.minutes().count()), int(time.seconds().count()), int(time.subseconds().count()));
    return text;
}

// The place that a message begins with. A name without a line may be the begin of a sentence, so it is taken
// for that of a file if there is one.
Place place_at_begin(std::string_view line) {
    const std::string_view text = line.substr(0, line.find(": "));
    Place place = parse_place(text);
    std::error_code error;
    const bool is_file = text.size() < line.size() && std::filesystem::is_regular_file(text, error);
    return place.line > 0 || is_file ? place : Place{};
}

// The id of what has none of its own: where it is.
std::string general_id(const Place& place) {
    if (place.file.starts_with("-")) return "option";
    if (place.line > 0) return "line";
    return place.file.empty() ? "program" : "file";
}

std::string as_json(LogLevel level, const std::string& id, const Place& place,
                    std::initializer_list<std::pair<const char*, std::string_view>> texts) {
    constexpr std::array levels = {"info", "warning", "error"};
    nlohmann::ordered_json object = {
        {"time", time_text()}, {"level", levels[size_t(level)]}, {"id", id.empty() ? general_id(place) : id}, {"file", place.file},
        {"line", place.line},  {"column", place.column}};
    for (const auto& [name, text] : texts) object[name] = text;
    return object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// In one piece, so that lines of several threads do not mix.
void write_line(std::string line) {
    line += '\n';
    draw(line);
}

void write_problem(LogLevel level, const Problem& problem) {
    if (log_format() != LogFormat::json) return write_message(level, to_string(problem));
    write_line(as_json(level, problem.id, problem.place, {{"what", problem.what}, {"fix", problem.fix}}));
}

} // namespace

void print_warning(const Problem& warning) { write_problem(LogLevel::warning, warning); }

void print_note(const Problem& note) {
    if (isatty(STDERR_FILENO) && log_format() != LogFormat::json) draw("\r\033[K"); // over the progress line
    write_problem(LogLevel::info, note);
}

void set_log_format(LogFormat format) { format_of_messages = format; }
LogFormat log_format() { return format_of_messages; }

std::string time_text() { return now_as_text().data(); }

void open_standard_streams() {
    for (int wanted = STDIN_FILENO; wanted <= STDERR_FILENO; ++wanted) {
        if (::fcntl(wanted, F_GETFD) >= 0) continue;
        // Standard output is opened for reading: writing to it must still fail, and be reported. A folder
        // does where there is no /dev/null.
        const int mode = wanted == STDERR_FILENO ? O_RDWR : O_RDONLY;
        int opened = ::open("/dev/null", mode);
        if (opened < 0) opened = ::open("/", O_RDONLY);
        if (opened != wanted) ::_exit(exit_bad_input); // lower ones are open, so this is the number
    }
}

void draw(std::string_view text) { (void)std::fwrite(text.data(), 1, text.size(), stderr); }

void write_message(LogLevel level, std::string_view line) {
    if (line.ends_with('\n')) line.remove_suffix(1);
    switch (log_format()) {
    case LogFormat::text:
        return write_line(std::string(line));
    case LogFormat::time:
        return write_line(fmt::format("{} {}", now_as_text().data(), line));
    case LogFormat::json:
        return write_line(as_json(level, "", place_at_begin(line), {{"text", line}}));
    }
}

void write_error_without_memory(const char* line) {
    std::array<char, 800> safe{};
    const LogFormat format = log_format();
    for (size_t i = 0; i + 1 < safe.size() && line[i] != 0; ++i) {
        const char c = line[i];
        const bool would_end_it = c == '"' || c == '\\' || static_cast<unsigned char>(c) < 32;
        safe[i] = format == LogFormat::json && would_end_it ? '\'' : c;
    }
    std::array<char, 1024> text{};
    if (format == LogFormat::text)
        std::snprintf(text.data(), text.size(), "%s\n", safe.data());
    else if (format == LogFormat::time)
        std::snprintf(text.data(), text.size(), "%s %s\n", now_as_text().data(), safe.data());
    else
        std::snprintf(
            text.data(), text.size(),
            R"({"time":"%s","level":"error","id":"memory","file":"","line":0,"column":0,"what":"%s","fix":""})"
            "\n",
            now_as_text().data(), safe.data());
    if (::write(STDERR_FILENO, text.data(), std::strlen(text.data())) < 0) return; // nobody listens
}

void write_result(std::string_view text) {
    errno = 0;
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size()) keep_error();
}

void print_problems(const std::vector<Problem>& problems) {
    for (size_t i = 0; i < std::min(problems.size(), max_problems); ++i)
        write_problem(LogLevel::error, problems[i]);
    if (problems.size() > max_problems)
        write_problem(LogLevel::error, {{"marram"},
                                        fmt::format("{} more mistakes", problems.size() - max_problems),
                                        "correct those above first"});
}

void keep_running_without_reader() { reader_may_leave = std::signal(SIGPIPE, SIG_IGN) != SIG_IGN; }

void flush_results() {
    errno = 0;
    if (std::fflush(stdout) != 0) keep_error();
}

void check_results() {
    flush_results();
    const int error = result_error.load();
    if (error == 0) return;
    if (error == EPIPE && reader_may_leave) {
        std::signal(SIGPIPE, SIG_DFL);
        ::raise(SIGPIPE);
    }
    throw InputError({"standard output"}, std::string("could not be written (") + std::strerror(error) + ")",
                     "check where it goes; the files that it would have named are whole");
}

} // namespace marram
