// SPDX-License-Identifier: Apache-2.0
// The commands and options of a program as plain text, read from its command line parser, for completion and
// man pages.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace marram {

struct OptionText {
    std::vector<std::string> names;      // "-o", "--output"; for a positional argument its name only
    std::string value;                   // "FILE", "NUMBER", "rest|bent|final", ...; "" for a flag
    std::string range;                   // of numbers, "1 to 1024"; "" if not limited
    std::vector<std::string> choices;    // empty: any value
    std::vector<std::string> excludes{}; // names of options that it cannot be combined with
    std::string help, initial;           // initial: the default, "" if there is none or help states it
    bool positional = false, required = false, many = false;
};

struct CommandText {
    std::string name, help;
    std::vector<OptionText> options; // in the order of their declaration, --help first
};

struct ExitCode {
    int code;
    const char* meaning;
};

struct ProgramText {
    CommandText program;
    std::vector<CommandText> commands;
    std::vector<ExitCode> exit_codes;
};

ProgramText program_text(const CLI::App& app, std::span<const ExitCode> exit_codes);

} // namespace marram
