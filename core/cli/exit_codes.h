// SPDX-License-Identifier: Apache-2.0
// Exit codes of `marram`, besides 0 (done, alike) and 1 (different).
#pragma once

namespace marram {

inline constexpr int exit_bad_input = 2;
inline constexpr int exit_interrupted = 130; // 128 + SIGINT, as shells have it

} // namespace marram
