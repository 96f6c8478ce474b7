// SPDX-License-Identifier: Apache-2.0
#include "core/manual/command_text.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace marram {
namespace {

// CLI11 describes the value of an option as TYPE:CHECK: "TEXT:{rest,bent,final}", "FLOAT:1 to 10",
// "INT:INT in [1 - 1024]".
void add_value(OptionText& text, const std::string& type) {
    const size_t end = std::min(type.find(':'), type.size());
    text.value = type.substr(0, end);
    const std::string check = type.substr(std::min(end + 1, type.size()));
    if (text.value.starts_with("LAYER")) { // "LAYER:...": the colon is part of the name
        text.value = type;
    } else if (check.starts_with("{") && check.ends_with("}")) {
        for (size_t begin = 1; begin < check.size();) {
            const size_t comma = std::min(check.find(',', begin), check.size() - 1);
            text.choices.push_back(check.substr(begin, comma - begin));
            begin = comma + 1;
        }
        text.value = fmt::format("{}", fmt::join(text.choices, "|"));
    } else if (const size_t bracket = check.find("in ["); bracket != std::string::npos) {
        text.range = check.substr(bracket + 4, check.size() - bracket - 5);
        if (const size_t minus = text.range.find(" - "); minus != std::string::npos)
            text.range.replace(minus, 3, " to ");
    } else {
        text.range = check;
    }
    if (text.value == "FLOAT" || text.value == "INT" || text.value == "UINT") text.value = "NUMBER";
}

OptionText option_text(const CLI::Option& option) {
    OptionText text;
    text.positional = option.get_positional();
    if (text.positional) {
        text.names = {option.get_name(true)};
    } else {
        for (const std::string& name : option.get_snames()) text.names.push_back("-" + name);
        for (const std::string& name : option.get_lnames()) text.names.push_back("--" + name);
    }
    if (option.get_items_expected_max() > 0) add_value(text, option.get_type_name());
    text.help = option.get_description();
    text.initial = option.get_default_str();
    text.required = option.get_required();
    for (const CLI::Option* other : option.get_excludes()) text.excludes.push_back(other->get_name());
    std::ranges::sort(text.excludes);
    text.many = option.get_expected_max() > 1;
    return text;
}

CommandText command_text(const CLI::App& app) {
    CommandText text{app.get_name(), app.get_description(), {}};
    for (const CLI::Option* option : app.get_options()) text.options.push_back(option_text(*option));
    return text;
}

} // namespace

ProgramText program_text(const CLI::App& app, std::span<const ExitCode> exit_codes) {
    ProgramText text{command_text(app), {}, {exit_codes.begin(), exit_codes.end()}};
    for (const CLI::App* command : app.get_subcommands({})) text.commands.push_back(command_text(*command));
    return text;
}

} // namespace marram
