// SPDX-License-Identifier: Apache-2.0
// What the command line says of itself: the declarations of cli.cpp as plain text, for completion and man pages.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace marram {

struct OptionText {
    std::vector<std::string> names;      // "-o", "--output"; of a positional one its name alone
    std::string value;                   // what it takes: "FILE", "NUMBER", "rest|bent|final"; "" for a flag
    std::string range;                   // of numbers, "1 to 1024"; "" where nothing is said
    std::vector<std::string> choices;    // none: anything
    std::vector<std::string> excludes{}; // names of options that it cannot stand beside
    std::string help, initial;           // initial: the default, "" where help says it
    bool positional = false, required = false, many = false;
};

struct CommandText {
    std::string name, help;
    std::vector<OptionText> options; // in the order of their declaration, --help first
};

// The program, and its commands.
struct ProgramText {
    CommandText program;
    std::vector<CommandText> commands;
};

ProgramText program_text(const CLI::App& app);

// Words that complete values, as far as they do not depend on a scene.
struct CompletionWords {
    std::vector<std::string> subjects; // of `marram info`
    std::vector<std::string> layers;
};

// What `marram completion` prints.
std::string bash_completion(const ProgramText& text, const CompletionWords& words);
std::string zsh_completion(const ProgramText& text, const CompletionWords& words);

// Pages in roff: of the program, or of one of its commands.
std::string program_page(const ProgramText& text);
std::string command_page(const ProgramText& text, const CommandText& command);

} // namespace marram
