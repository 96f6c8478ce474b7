// SPDX-License-Identifier: Apache-2.0
// The commands and options declared in cli.cpp as plain text, for completion and man pages.
#pragma once

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

struct ProgramText {
    CommandText program;
    std::vector<CommandText> commands;
};

ProgramText program_text(const CLI::App& app);

// Words that complete values and do not depend on a scene.
struct CompletionWords {
    std::vector<std::string> subjects; // arguments of `marram info`
    std::vector<std::string> layers;
};

// What `marram completion` prints.
std::string bash_completion(const ProgramText& text, const CompletionWords& words);
std::string zsh_completion(const ProgramText& text, const CompletionWords& words);

// Man pages in roff: of the program, or of one of its commands.
std::string program_page(const ProgramText& text);
std::string command_page(const ProgramText& text, const CommandText& command);

} // namespace marram
