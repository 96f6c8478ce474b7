// SPDX-License-Identifier: Apache-2.0
// Memory by address: all of it can be read and written, and what was never written costs none. So arrays of
// which only a part is ever needed keep their plain indices.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <new>

namespace marram {

class ReservedMemory {
  public:
    // Zeros. Throws std::bad_alloc where the system reserves none (a limit of address space).
    explicit ReservedMemory(size_t bytes) : bytes_(bytes > 0 ? bytes : 1) {
        memory_ =
            mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (memory_ == MAP_FAILED) throw std::bad_alloc();
    }
    ~ReservedMemory() { munmap(memory_, bytes_); }
    ReservedMemory(const ReservedMemory&) = delete;
    ReservedMemory& operator=(const ReservedMemory&) = delete;

    template <typename T>
    T* as() const {
        return static_cast<T*>(memory_);
    }

    // Gives back the pages that lie wholly in a range, which are zeros again.
    static void give_back(void* begin, size_t bytes) {
        const auto page = size_t(sysconf(_SC_PAGESIZE));
        const auto from = (reinterpret_cast<uintptr_t>(begin) + page - 1) / page * page,
                   to = (reinterpret_cast<uintptr_t>(begin) + bytes) / page * page;
        if (from < to) madvise(reinterpret_cast<void*>(from), to - from, MADV_DONTNEED);
    }

  private:
    size_t bytes_;
    void* memory_ = nullptr;
};

} // namespace marram
