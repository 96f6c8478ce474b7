// SPDX-License-Identifier: Apache-2.0
// Memory of this process that is in RAM now.
#pragma once

#include <unistd.h>

#include <cstdint>
#include <cstdio>

namespace marram {

// Bytes, from /proc/self/statm: a few microseconds. 0 where there is none.
inline uint64_t resident_bytes() {
    unsigned long long pages = 0;
    if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
        if (std::fscanf(file, "%*u %llu", &pages) != 1) pages = 0;
        std::fclose(file);
    }
    return pages * uint64_t(sysconf(_SC_PAGESIZE));
}

} // namespace marram
