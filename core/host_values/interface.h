// SPDX-License-Identifier: Apache-2.0
// For the functions of core/plugin/marram_host.h: messages to the host, and no exceptions.
#pragma once

#include "core/math/problem.h"
#include "core/plugin/marram_host.h"

#include <type_traits>

namespace marram {

inline void say(const MarramHost* host, const char* id, const char* place, const char* what,
                const char* remedy) {
    if (!host || !host->message) return;
    const MarramMessage message{sizeof(MarramMessage), MARRAM_FAULT, id, place, what, remedy};
    host->message(host->user, &message);
}

inline void say(const MarramHost* host, const Problem& problem) {
    say(host, problem.id.c_str(), problem.place.file.c_str(), problem.what.c_str(), problem.fix.c_str());
}

// Returns what work() returns; after an exception, which can only be one of memory, calls failed() instead.
template <typename Work, typename Failed>
std::invoke_result_t<Work> guarded(Work work, Failed failed) noexcept {
    try {
        return work();
    } catch (...) {
        return failed();
    }
}

} // namespace marram
