// SPDX-License-Identifier: Apache-2.0
#include "core/cli/memory.h"

#include "core/cli/exit_codes.h"
#include "core/cli/output.h"

#include "core/image/atomic_file.h"

#include <tbb/scalable_allocator.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>

#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

namespace marram {
namespace {

bool has_room_for(size_t bytes) {
    void* at = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (at == MAP_FAILED) return false;
    ::munmap(at, bytes);
    return true;
}

// Whether there is too little memory for a thread's stack.
bool memory_is_short() { return !has_room_for(size_t(16) << 20); }

// Whether no thread can be started although there is memory for it.
bool threads_are_short() {
    if (memory_is_short()) return false;
    pthread_t thread{};
    const auto nothing = [](void*) -> void* { return nullptr; };
    if (pthread_create(&thread, nullptr, nothing, nullptr) != 0) return true;
    pthread_join(thread, nullptr);
    return false;
}

[[noreturn]] void end_with(const char* text) {
    write_error_without_memory(text);
    remove_temporary_files();
    _exit(exit_bad_input);
}

// Where the limit may be raised, it is: for this thread at once, for others as their default.
void check_stack() {
    constexpr rlim_t enough = rlim_t(1) << 20;
    rlimit limit{};
    if (::getrlimit(RLIMIT_STACK, &limit) != 0 || limit.rlim_cur >= enough) return;
    limit.rlim_cur = std::min(limit.rlim_max, enough);
    if (limit.rlim_cur < enough || ::setrlimit(RLIMIT_STACK, &limit) != 0)
        end_with("marram: the stack is limited to less than 1 MiB: allow more, such as by ulimit -s 8192");
    pthread_attr_t defaults;
    if (pthread_attr_init(&defaults) != 0) return;
    pthread_attr_setstacksize(&defaults, enough);
    pthread_setattr_default_np(&defaults);
    pthread_attr_destroy(&defaults);
}

[[noreturn]] void on_terminate() {
    try {
        if (std::current_exception()) std::rethrow_exception(std::current_exception());
    } catch (const std::exception& error) {
        if (is_lack_of_memory(error)) end_for_lack_of_memory_or_threads();
        write_error_without_memory(error.what());
    } catch (...) {
    }
    if (memory_is_short()) end_for_lack_of_memory();
    std::abort();
}

void on_crash(int signal) {
    if (memory_is_short()) end_for_lack_of_memory();
    std::signal(signal, SIG_DFL);
    ::raise(signal);
}

} // namespace

void end_for_lack_of_memory() {
    end_with(
        "marram: the process has run out of memory: use fewer strands, CVs, motion keys, pixels or threads, "
        "or allow it more memory");
}

void end_for_lack_of_memory_or_threads() {
    if (threads_are_short())
        end_with("marram: no thread can be started: raise the limit on processes (ulimit -u, or that of the "
                 "container)");
    end_for_lack_of_memory();
}

void return_large_blocks_when_freed() { mallopt(M_MMAP_THRESHOLD, 1 << 20); }

// TBB's containers and aligned vectors have an allocator of their own, which keeps what is freed for the
// thread that freed it.
void release_free_memory() {
    scalable_allocation_command(TBBMALLOC_CLEAN_ALL_BUFFERS, nullptr);
    malloc_trim(0);
}

void watch_for_lack_of_memory() {
    check_stack();
    if (memory_is_short()) end_for_lack_of_memory();
    std::set_terminate(on_terminate);
    for (const int signal : {SIGSEGV, SIGBUS, SIGABRT}) std::signal(signal, on_crash);
}

bool is_lack_of_memory(const std::exception& error) {
    if (dynamic_cast<const std::bad_alloc*>(&error)) return true;
    for (const int code : {EAGAIN, ENOMEM})
        if (std::strstr(error.what(), std::strerror(code))) return true;
    return false;
}

} // namespace marram
