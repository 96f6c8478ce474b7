// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/output.h"
#include "core/image/atomic_file.h"
#include "core/manual/man_page.h"
#include "core/manual/scene_reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

namespace marram {

int completion_command(const std::string& shell, const ProgramText& text) {
    const CompletionWords words = completion_words(default_plugins());
    print_result("{}", shell == "bash" ? bash_completion(text, words) : zsh_completion(text, words));
    return exit_done;
}

int man_command(const ManOptions& options, const ProgramText& text) {
    const auto page = [&](const std::string& name) {
        const auto command = std::ranges::find(text.commands, name, &CommandText::name);
        return command == text.commands.end() ? program_page(text) : command_page(text, *command);
    };
    if (options.folder.empty()) {
        print_result("{}", page(options.command));
        return exit_done;
    }
    std::vector<std::string> names = {options.command};
    if (options.command.empty())
        for (const CommandText& command : text.commands) names.push_back(command.name);
    std::error_code error;
    std::filesystem::create_directories(options.folder, error);
    if (!std::filesystem::is_directory(options.folder))
        throw InputError({options.folder}, "the folder for the pages cannot be made",
                         "name another with --out, or make it");
    for (const std::string& name : names) {
        const std::string file = "marram" + (name.empty() ? "" : "-" + name) + ".1";
        const std::string path = (std::filesystem::path(options.folder) / file).string();
        AtomicFile writer(path, Links::replace);
        writer.write(page(name));
        writer.commit();
        print_result("{}\n", path);
    }
    return exit_done;
}

} // namespace marram
