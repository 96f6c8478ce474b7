// SPDX-License-Identifier: Apache-2.0
// The program: parses the command line and runs one command.
#pragma once

namespace marram {

// Returns the exit code: 0 done, 1 `compare` found a difference, 2 bad input (one line on stderr for each
// mistake), 128 + the signal that interrupted it.
int run(int argc, char** argv);

} // namespace marram
