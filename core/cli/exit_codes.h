// SPDX-License-Identifier: Apache-2.0
// Exit codes of `marram`.
#pragma once

#include "core/manual/command_text.h"

namespace marram {

inline constexpr int exit_done = 0;
inline constexpr int exit_different = 1;
inline constexpr int exit_bad_input = 2;
inline constexpr int exit_interrupted = 130; // 128 + SIGINT, as shells have it

inline constexpr ExitCode exit_codes[] = {
    {exit_done, "done; the pictures of marram compare are alike"},
    {exit_different, "the pictures of marram compare are different"},
    {exit_bad_input, "bad input: stderr has one line for each mistake, file:line:column: what is wrong: what "
                     "to do; or marram "
                     "compare cannot tell: noise could hide a difference"},
    {exit_interrupted, "interrupted: what was there is saved under a name that says partial"}};

} // namespace marram
