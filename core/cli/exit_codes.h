// SPDX-License-Identifier: Apache-2.0
// Exit codes of `marram`.
#pragma once

#include "core/manual/command_text.h"

#include <csignal>

namespace marram {

inline constexpr int exit_done = 0;
inline constexpr int exit_different = 1;
inline constexpr int exit_bad_input = 2;

// After an interrupt: 128 + the number of the first signal, as shells have it.
inline constexpr int exit_interrupted = 128 + SIGINT;

inline constexpr ExitCode exit_codes[] = {
    {exit_done, "done; the pictures of marram compare are alike"},
    {exit_different, "the pictures of marram compare are different"},
    {exit_bad_input, "bad input: stderr has one line for each mistake, file:line:column: what is wrong: what "
                     "to do; or marram "
                     "compare cannot tell: noise could hide a difference"},
    {128 + SIGHUP, "interrupted by SIGHUP: the terminal is gone; what was there is saved, as after SIGINT"},
    {exit_interrupted, "interrupted by SIGINT (Ctrl-C): of a render, the picture is saved under a name that "
                       "says partial, and the state from which --resume goes on to the same bits"},
    {128 + SIGUSR1, "interrupted by SIGUSR1, by which batch systems tell that time is nearly up; as SIGINT"},
    {128 + SIGUSR2, "interrupted by SIGUSR2; as SIGINT"},
    {128 + SIGTERM, "interrupted by SIGTERM: cancelled, preempted or out of time; as SIGINT"},
    {128 + SIGXCPU, "interrupted by SIGXCPU: the limit on processor time; as SIGINT"}};

} // namespace marram
