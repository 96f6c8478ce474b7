// SPDX-License-Identifier: Apache-2.0
// Wall time.
#pragma once

#include <chrono>

namespace marram {

// Seconds on a monotonic clock.
inline double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

} // namespace marram
