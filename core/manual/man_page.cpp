// SPDX-License-Identifier: Apache-2.0
#include "core/manual/man_page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>

namespace marram {
namespace {

// Escapes text for roff: a hyphen stays an ASCII hyphen, and no line begins with a control character.
std::string roff(const std::string& text) {
    std::string out;
    for (const char c : text) {
        const bool line_begins = out.empty() || out.back() == '\n';
        if (line_begins && (c == '.' || c == '\'')) out += "\\&";
        if (c == '\\')
            out += "\\e";
        else if (c == '-')
            out += "\\-";
        else if (c == '~')
            out += "\\(ti";
        else if (c == '^')
            out += "\\(ha";
        else
            out += c;
    }
    return out;
}

std::string sentence(std::string text) {
    if (text.empty()) return text;
    if (!text.starts_with("--")) text[0] = char(std::toupper(static_cast<unsigned char>(text[0])));
    return text.ends_with(".") ? text : text + ".";
}

std::string header(const std::string& title) {
    std::string upper = title;
    for (char& c : upper) c = char(std::toupper(static_cast<unsigned char>(c)));
    return fmt::format(".\\\" Made by `marram man`.\n.TH {} 1 \"\" \"marram {}\" \"Marram\"\n.nh\n.ad l\n",
                       roff(upper), MARRAM_VERSION);
}

std::string name_section(const std::string& title, const std::string& help) {
    std::string line = help; // without its full stop, as whatis(1) prints it
    if (line.ends_with(".")) line.pop_back();
    return fmt::format(".SH NAME\n{} \\- {}\n", roff(title), roff(line));
}

std::string option_section(const CommandText& command) {
    std::string text = ".SH OPTIONS\n";
    for (const bool positional : {true, false})
        for (const OptionText& option : command.options) {
            if (option.positional != positional) continue;
            text += ".TP\n";
            for (size_t i = 0; i < option.names.size(); ++i)
                text += fmt::format("{}\\f{}{}\\fR", i > 0 ? ", " : "", positional ? "I" : "B",
                                    roff(option.names[i]));
            if (!positional && !option.value.empty()) text += " \\fI" + roff(option.value) + "\\fR";
            text += "\n" + roff(sentence(option.help)) + "\n";
            if (positional && !option.choices.empty())
                text +=
                    "One of " + roff(fmt::format("{}", fmt::join(option.choices, ", "))) + ".\n"; // may wrap
            if (!option.range.empty()) text += "From " + roff(option.range) + ".\n";
            if (!option.initial.empty()) text += "Default: " + roff(option.initial) + "\n";
            if (option.required) text += "Required.\n";
            for (const std::string& other : option.excludes)
                text += "Not together with " + roff(other) + ".\n";
            if (option.many && !positional) text += "May be given several times.\n";
        }
    return text;
}

std::string exit_section(const ProgramText& program) {
    std::string text = ".SH EXIT STATUS\n";
    for (const ExitCode& code : program.exit_codes)
        text += fmt::format(".TP\n.B {}\n{}\n", code.code, roff(sentence(code.meaning)));
    return text;
}

std::string page_of(const CommandText& command) { return "marram-" + command.name; }

// References to all pages except `page`.
std::string see_also(const ProgramText& text, const std::string& page) {
    std::string out = ".SH SEE ALSO\n";
    std::vector<std::string> pages = {"marram"};
    for (const CommandText& command : text.commands) pages.push_back(page_of(command));
    std::erase(pages, page);
    for (size_t i = 0; i < pages.size(); ++i)
        out += fmt::format(".BR {} (1){}\n", roff(pages[i]), i + 1 < pages.size() ? "," : "");
    return out;
}

} // namespace

std::string program_page(const ProgramText& text) {
    std::string out = header("marram") + name_section("marram", text.program.help);
    out += ".SH SYNOPSIS\n.B marram\n.I COMMAND\n[\\fIOPTION\\fR ...]\n.SH DESCRIPTION\n" +
           roff(sentence(text.program.help)) + "\n.SH COMMANDS\n";
    for (const CommandText& command : text.commands)
        out += fmt::format(".TP\n.BR {} (1)\n{}\n", roff(page_of(command)), roff(sentence(command.help)));
    return out + option_section(text.program) + exit_section(text) + see_also(text, "marram");
}

std::string command_page(const ProgramText& text, const CommandText& command) {
    const std::string page = page_of(command);
    std::string out = header(page) + name_section(page, command.help);
    out += ".SH SYNOPSIS\n.B marram " + command.name + "\n";
    for (const OptionText& option : command.options) {
        const std::string dots = option.many ? " ..." : "";
        if (option.positional) {
            const std::string name = "\\fI" + roff(option.names[0]) + "\\fR";
            out += (option.required ? name : "[" + name + "]") + dots + "\n";
        } else if (option.required)
            out += fmt::format("\\fB{}\\fR \\fI{}\\fR\n", roff(option.names[0]), roff(option.value));
    }
    out += "[\\fIOPTION\\fR ...]\n.SH DESCRIPTION\n" + roff(sentence(command.help)) + "\n";
    return out + option_section(command) + exit_section(text) + see_also(text, page);
}

} // namespace marram
