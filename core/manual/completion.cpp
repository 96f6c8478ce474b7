// SPDX-License-Identifier: Apache-2.0
// Options and words are written into the script when it is made. Only the keys of a scene are queried from
// the program at each completion.
#include "core/manual/completion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <string_view>

namespace marram {
namespace {

// The kind of completion of a value.
enum class Kind { nothing, file, folder, scene, subject, choice, key, layers, layer_picture };

Kind kind_of(const OptionText& option) {
    if (!option.choices.empty()) return Kind::choice;
    if (option.positional) {
        const std::string& name = option.names[0];
        return name == "scene" ? Kind::scene : name == "subject" ? Kind::subject : Kind::file;
    }
    if (option.value == "FILE") return Kind::file;
    if (option.value == "DIR") return Kind::folder;
    if (option.value == "KEY=VALUE") return Kind::key;
    if (option.value == "NAME,...") return Kind::layers;
    return option.value.starts_with("LAYER") ? Kind::layer_picture : Kind::nothing;
}

// Escapes text for use within single quotes.
std::string single_quoted(const std::string& text) {
    std::string out;
    for (const char c : text)
        if (c == '\'')
            out += "'\\''";
        else
            out += c;
    return out;
}

// A word that a shell takes as it is written: in single quotes if it has characters that mean something to
// one.
std::string shell_word(const std::string& word) {
    const auto plain = [](unsigned char c) {
        return std::isalnum(c) || std::string_view("_-+./:,#@%").find(char(c)) != std::string_view::npos;
    };
    return !word.empty() && std::ranges::all_of(word, plain) ? word : "'" + single_quoted(word) + "'";
}

std::string words_of(const std::vector<std::string>& words) {
    std::vector<std::string> quoted;
    for (const std::string& word : words) quoted.push_back(shell_word(word));
    return fmt::format("{}", fmt::join(quoted, " "));
}

std::string names_of_options(const CommandText& command) {
    std::vector<std::string> names;
    for (const OptionText& option : command.options)
        if (!option.positional) names.insert(names.end(), option.names.begin(), option.names.end());
    return words_of(names);
}

std::string names_of_commands(const ProgramText& text) {
    std::vector<std::string> names;
    for (const CommandText& command : text.commands) names.push_back(command.name);
    return words_of(names);
}

// ---- bash ----------------------------------------------------------------------------------------------------------

constexpr const char* bash_begin = R"bash(# SPDX-License-Identifier: Apache-2.0
# Completion of marram in bash, made by `marram completion bash`: source it, or keep it as
# ~/.local/share/bash-completion/completions/marram
_marram_words() { mapfile -t COMPREPLY < <(compgen -W "$1" -- "$word"); }
_marram_files() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
}
_marram_folders() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -d -- "$word")
}
# And the folders that they may lie in.
_marram_scenes() {
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -d -- "$word"; compgen -f -X '!*.toml' -- "$word")
}
# Names between commas.
_marram_list() {
    local before=
    [[ $word == *,* ]] && before=${word%,*},
    compopt -o nospace 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -P "$before" -W "$1" -- "${word##*,}")
}
_marram_layer_picture() {
    if [[ $inside ]]; then
        _marram_files
    else
        compopt -o nospace 2>/dev/null
        _marram_words "$1"
    fi
}
_marram_keys() {
    local key quoted scene= program=${COMP_WORDS[0]/#\~/$HOME}
    local -a keys
    [[ $inside ]] && return
    for key in "${COMP_WORDS[@]}"; do [[ $key == *.toml ]] && scene=${key/#\~/$HOME}; done
    scene=${scene//[\\\"\']/} # as it is typed, quoted
    [[ $scene ]] && mapfile -t keys < <("$program" info --keys "$scene" 2>/dev/null)
    [[ ${keys[*]} ]] || mapfile -t keys < <("$program" info --keys 2>/dev/null)
    compopt -o nospace 2>/dev/null
    for key in "${keys[@]}"; do # names in a scene may contain anything
        printf -v quoted %q "$key"
        [[ $key == "$word"* || $quoted == "$word"* ]] && COMPREPLY+=("$quoted=")
    done
}
_marram() {
    local word=${COMP_WORDS[COMP_CWORD]} at=$((COMP_CWORD - 1)) equals= inside= command= scene= i
    COMPREPLY=()
    # To bash, --option=value is three words, and so is the key=value of an option.
    if [[ $word == = ]]; then
        word= equals=$COMP_CWORD
    elif [[ ${COMP_WORDS[at]} == = ]]; then
        equals=$at
    fi
    if [[ $equals ]]; then
        at=$((equals - 1))
        if [[ ${COMP_WORDS[at]} != --* ]]; then
            inside=1
            while ((at > 1)) && [[ ${COMP_WORDS[at]} != --* ]]; do at=$((at - 1)); done
        fi
    elif [[ ${COMP_WORDS[at]} == [:=] || $word == : ]]; then
        return
    fi
    for ((i = 1; i < COMP_CWORD; ++i)); do
        [[ ! $command && ${COMP_WORDS[i]} != -* ]] && command=${COMP_WORDS[i]}
        [[ ${COMP_WORDS[i]} == *.toml ]] && scene=1
    done
    case "$command ${COMP_WORDS[at]}" in
)bash";

// A list of words in double quotes. compgen -W expands what is in it once more.
std::string bash_words(const std::vector<std::string>& words) {
    std::string out = "\"";
    for (const char c : words_of(words)) {
        if (std::string_view("\\\"$`").find(c) != std::string_view::npos) out += '\\';
        out += c;
    }
    return out + "\"";
}

std::string bash_action(const OptionText& option, const CompletionWords& words) {
    switch (kind_of(option)) {
    case Kind::nothing:
        return ":";
    case Kind::file:
        return "_marram_files";
    case Kind::folder:
        return "_marram_folders";
    case Kind::scene:
        return "_marram_scenes";
    case Kind::subject:
        return fmt::format(
            "_marram_scenes; mapfile -t -O ${{#COMPREPLY[@]}} COMPREPLY < <(compgen -W {} -- \"$word\")",
            bash_words(words.subjects));
    case Kind::choice:
        return fmt::format("_marram_words {}", bash_words(option.choices));
    case Kind::key:
        return "_marram_keys";
    case Kind::layers:
        return fmt::format("_marram_list {}", bash_words(words.layers));
    case Kind::layer_picture:
        return fmt::format("_marram_layer_picture {}", bash_words(words.layers));
    }
    return ":";
}

// ---- zsh -----------------------------------------------------------------------------------------------------------

constexpr const char* zsh_begin = R"zsh(#compdef marram
# SPDX-License-Identifier: Apache-2.0
# Completion of marram in zsh, made by `marram completion zsh`: keep it as _marram in a folder of $fpath, or source it after compinit.
_marram_keys() {
    local -a keys
    local scene=${${(M)words:#*.toml}[1]}
    if compset -P '*='; then return; fi
    [[ -n $scene ]] && keys=(${(f)"$($_marram_program info --keys ${(Q)~scene} 2>/dev/null)"})
    (( $#keys )) || keys=(${(f)"$($_marram_program info --keys 2>/dev/null)"})
    compadd -S = -a keys
}
_marram_layer_picture() {
    if compset -P '*='; then _files; else compadd -S '' -- $@; fi
}
_marram_list() {
    compset -P '*,'
    compadd -S '' -- $@
}
_marram() {
    local context state line
    local -a commands
    local _marram_program=${~words[1]}
)zsh";

std::string escaped(const std::string& text, const std::string& special) {
    std::string out;
    for (const char c : text) {
        if (c == '\\' || special.find(c) != std::string::npos) out += '\\';
        out += c;
    }
    return single_quoted(out);
}

std::string zsh_action(const OptionText& option, const CompletionWords& words) {
    switch (kind_of(option)) {
    case Kind::nothing:
        return " ";
    case Kind::file:
        return "_files";
    case Kind::folder:
        return "_files -/";
    case Kind::scene:
        return "_files -g \"*.toml\"";
    case Kind::subject:
        return fmt::format("{{compadd -- {}; _files -g \"*.toml\"}}", words_of(words.subjects));
    case Kind::choice:
        return fmt::format("({})", words_of(option.choices));
    case Kind::key:
        return "_marram_keys";
    case Kind::layers:
        return fmt::format("_marram_list {}", words_of(words.layers));
    case Kind::layer_picture:
        return fmt::format("_marram_layer_picture {}", words_of(words.layers));
    }
    return " ";
}

// One argument of zsh's _arguments, quoted for the shell.
std::string zsh_spec(const OptionText& option, const CompletionWords& words) {
    const std::string help = "[" + escaped(option.help, "[]:") + "]";
    const std::string action = single_quoted(zsh_action(option, words));
    if (option.positional)
        return fmt::format("'{}{}:{}'",
                           option.many       ? "*:"
                           : option.required ? ":"
                                             : "::",
                           escaped(option.names[0], ":"), action);
    const std::string value =
        option.value.empty() ? "" : fmt::format(":{}:{}", escaped(option.value, ":"), action);
    const bool many = option.many;
    if (option.names.size() == 1)
        return fmt::format("'{}{}{}{}'", many ? "*" : "", option.names[0], help, value);
    const std::string braces = fmt::format("{{{}}}", fmt::join(option.names, ","));
    return fmt::format("'{}'{}'{}{}'", many ? "*" : fmt::format("({})", words_of(option.names)), braces, help,
                       value);
}

} // namespace

std::string bash_completion(const ProgramText& text, const CompletionWords& words) {
    std::string out = bash_begin;
    for (const CommandText& command : text.commands)
        for (const OptionText& option : command.options) {
            if (option.positional || option.value.empty()) continue;
            std::vector<std::string> patterns;
            for (const std::string& name : option.names)
                patterns.push_back(fmt::format("\"{} {}\"", command.name, name));
            out += fmt::format("        {}) {}; return ;;\n", fmt::join(patterns, " | "),
                               bash_action(option, words));
        }
    out += "    esac\n    [[ $equals ]] && return\n    case \"$command\" in\n";
    out += fmt::format("        \"\") _marram_words \"{} {}\" ;;\n", names_of_commands(text),
                       names_of_options(text.program));
    for (const CommandText& command : text.commands) {
        out += fmt::format("        {})\n            if [[ $word == -* ]]; then _marram_words \"{}\"",
                           command.name, names_of_options(command));
        const auto first = std::ranges::find_if(command.options, &OptionText::positional);
        if (first != command.options.end()) {
            if (kind_of(*first) == Kind::scene) // a scene is given: complete options only
                out += fmt::format("\n            elif [[ $scene ]]; then _marram_words \"{}\"",
                                   names_of_options(command));
            out += fmt::format("\n            else {}", bash_action(*first, words));
        }
        out += "; fi ;;\n";
    }
    return out + "    esac\n}\ncomplete -F _marram marram\n";
}

std::string zsh_completion(const ProgramText& text, const CompletionWords& words) {
    std::string out = zsh_begin;
    out += "    commands=(\n";
    for (const CommandText& command : text.commands)
        out += fmt::format("        '{}:{}'\n", command.name, escaped(command.help, ":"));
    out += "    )\n    _arguments -C";
    for (const OptionText& option : text.program.options) out += " \\\n        " + zsh_spec(option, words);
    out += " \\\n        '1:command:->command' \\\n        '*::argument:->argument'\n    case $state in\n";
    out += "    command) _describe command commands ;;\n    argument)\n        case $words[1] in\n";
    for (const CommandText& command : text.commands) {
        out += fmt::format("        {})\n            _arguments", command.name);
        for (const OptionText& option : command.options)
            out += " \\\n                " + zsh_spec(option, words);
        out += " ;;\n";
    }
    out += "        esac ;;\n    esac\n}\n";
    return out + "if [[ $funcstack[1] == _marram ]]; then _marram \"$@\"; else compdef _marram marram; fi\n";
}

} // namespace marram
