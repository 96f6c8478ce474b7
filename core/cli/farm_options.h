// SPDX-License-Identifier: Apache-2.0
// Options for programs that start and watch this one: render farms, batch systems, scripts.
#pragma once

#include <cstdint>

namespace CLI {
class App;
class Option;
} // namespace CLI

namespace marram {

struct FrameRequest;

// --log of every command of the program. Call it after the commands have been added.
void add_log(CLI::App& program);

// --progress of a command.
void add_progress(CLI::App& command);

// --frames-dialect and --skip-outside of a command that has --frames.
void add_frame_lists(CLI::App& command, FrameRequest& frames);

// --checkpoint, without a check of the number. Call it after --watch has been added.
CLI::Option* add_checkpoint(CLI::App& command, double& seconds);

// --memory of a command: bytes.
void add_memory(CLI::App& command, uint64_t& bytes);

// Reads --log and --progress before the command line is parsed, so that its mistakes are printed in that way,
// too. Values that do not exist are left to the parser.
void set_message_options(int argc, const char* const* argv);

} // namespace marram
