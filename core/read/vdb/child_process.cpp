// SPDX-License-Identifier: Apache-2.0
#include "core/read/vdb/child_process.h"

#include <fmt/format.h>

#include <openvdb/io/Stream.h>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <new>
#include <optional>
#include <sstream>

namespace marram {
namespace {

// What the child process writes first: refused, then a text (what is wrong, a newline, the remedy); or read.
enum class ReadStatus : uint32_t { refused = 1, read = 2 };

void set_limit(int resource, rlim_t most) {
    const rlimit limits{most, most};
    ::setrlimit(resource, &limits);
}

[[noreturn]] void child_main(int file, std::string& bytes,
                             const std::function<void(int, std::string&)>& send) {
    ::alarm(unsigned(30 + bytes.size() / 1'000'000)); // s
    size_t pages = 0;                                 // virtual memory now
    std::ifstream("/proc/self/statm") >> pages;
    set_limit(RLIMIT_AS, pages * size_t(::sysconf(_SC_PAGESIZE)) + 64 * bytes.size() + (size_t(512) << 20));
    set_limit(RLIMIT_CPU, 10 + bytes.size() / 2'000'000); // s
    set_limit(RLIMIT_CORE, 0);
    if (const int null = ::open("/dev/null", O_WRONLY); null >= 0) ::dup2(null, STDERR_FILENO);
    for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGTERM}) ::signal(signal, SIG_DFL);
    ::signal(SIGINT, SIG_IGN); // Ctrl-C is for the parent
    Refusal refusal;
    try {
        send(file, bytes);
        ::_exit(0);
    } catch (const Refusal& fault) {
        refusal = fault;
    } catch (const std::bad_alloc&) {
        refusal = {"needs too much memory, or is damaged", "write it with larger voxels, or again"};
    } catch (...) { // OpenVDB's texts say nothing to a user
        refusal = {"is no OpenVDB file, or is damaged", "write it again"};
    }
    const ReadStatus status = ReadStatus::refused;
    std::replace(refusal.what.begin(), refusal.what.end(), '\n', ' '); // names of grids
    const std::string text = refusal.what.substr(0, 1000) + '\n' + refusal.remedy;
    write_all(file, &status, sizeof status);
    write_all(file, text.data(), text.size());
    ::_exit(0);
}

// False at the end of the pipe.
bool read_some(int file, void* data, size_t count) {
    char* bytes = static_cast<char*>(data);
    while (count > 0) {
        const ssize_t n = ::read(file, bytes, count);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes += n, count -= size_t(n);
    }
    return true;
}

// Throws Refusal with the child's, if it has one.
void receive_status(int file) {
    ReadStatus status{};
    read_all(file, &status, sizeof status);
    if (status == ReadStatus::read) return;
    std::string text;
    for (char c = 0; text.size() < 4096 && read_some(file, &c, 1);) text += c;
    const size_t newline = text.find('\n');
    if (status != ReadStatus::refused || newline == std::string::npos) throw damaged_file;
    throw Refusal{text.substr(0, newline), text.substr(newline + 1)};
}

} // namespace

void write_all(int file, const void* data, size_t count) {
    const char* bytes = static_cast<const char*>(data);
    while (count > 0) {
        const ssize_t n = ::write(file, bytes, count);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) ::_exit(1);
        bytes += n, count -= size_t(n);
    }
}

void read_all(int file, void* data, size_t count) {
    if (!read_some(file, data, count)) throw damaged_file;
}

void begin_sending(int file) {
    const ReadStatus status = ReadStatus::read;
    write_all(file, &status, sizeof status);
}

openvdb::GridPtrVecPtr grids_of(std::string& bytes) {
    std::istringstream in(std::move(bytes));
    in.exceptions(std::ios::failbit | std::ios::badbit); // OpenVDB does not check for the end
    constexpr bool read_values_later = false;
    auto* stream =
        new openvdb::io::Stream(in, read_values_later); // not deleted: OpenVDB would do it in parallel
    return stream->getGrids();
}

std::string description_of(const openvdb::GridBase& grid) {
    return fmt::format("\"{}\" ({}, {})", grid.getName(), grid.valueType(),
                       openvdb::GridBase::gridClassToString(grid.getGridClass()));
}

void read_in_child_process(const std::string& path, std::string& bytes,
                           const std::function<void(int, std::string&)>& send,
                           const std::function<void(int)>& receive) {
    openvdb::initialize();
    int pipe_ends[2];
    if (::pipe2(pipe_ends, O_CLOEXEC) != 0)
        throw InputError(Place{path}, "cannot be read: too many files are open", "close some");
    const pid_t child = ::fork();
    const int fork_error = errno;
    if (child == 0) {
        ::close(pipe_ends[0]); // so that it ends if the parent does
        child_main(pipe_ends[1], bytes, send);
    }
    ::close(pipe_ends[1]);
    bytes.clear();
    bytes.shrink_to_fit();
    std::optional<Refusal> refusal;
    try {
        if (child < 0)
            throw Refusal{
                fmt::format("cannot be read: no process can be started ({})", std::strerror(fork_error)),
                "raise the limit on processes (ulimit -u), or free some memory"};
        receive_status(pipe_ends[0]);
        receive(pipe_ends[0]);
    } catch (const Refusal& fault) {
        refusal = fault;
    } catch (const std::bad_alloc&) {
        refusal = {"does not fit into memory", "write it with larger voxels"};
    } catch (const std::exception&) { // a transform without an inverse
        refusal = damaged_file;
    }
    ::close(pipe_ends[0]);
    if (child > 0) {
        if (refusal) ::kill(child, SIGKILL);
        while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
        }
    }
    if (refusal) throw InputError(Place{path}, refusal->what, refusal->remedy);
}

} // namespace marram
