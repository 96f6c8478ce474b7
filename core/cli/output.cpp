// SPDX-License-Identifier: Apache-2.0
#include "core/cli/output.h"

#include "core/cli/exit_codes.h"

#include "core/math/problem.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

#include <fcntl.h>
#include <unistd.h>

namespace marram {
namespace {

std::atomic<int> result_error{0};   // errno of the first failed write of a result
bool reader_may_leave = false;      // SIGPIPE was not ignored by who started the program
constexpr size_t max_problems = 50; // printed; the rest is a count

void keep_error() {
    int none = 0;
    result_error.compare_exchange_strong(none, errno != 0 ? errno : EIO);
}

} // namespace

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

void write_message(std::string_view text) { (void)std::fwrite(text.data(), 1, text.size(), stderr); }

void write_result(std::string_view text) {
    errno = 0;
    if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size()) keep_error();
}

void print_problems(const std::vector<Problem>& problems) {
    for (size_t i = 0; i < std::min(problems.size(), max_problems); ++i)
        print_message("{}\n", to_string(problems[i]));
    if (problems.size() > max_problems)
        print_message("marram: {} more mistakes: correct those above first\n",
                      problems.size() - max_problems);
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
