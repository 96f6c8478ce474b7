// SPDX-License-Identifier: Apache-2.0
#include "core/cli/scene_options.h"

#include <string>
#include <utility>
#include <vector>

namespace marram {

void add_path_map(CLI::App& command, PathMap& paths) {
    using Texts = std::vector<std::string>;
    command
        .add_option_function<Texts>(
            "--map",
            [&paths](const Texts& texts) {
                for (size_t i = 0; i < texts.size(); ++i)
                    paths.rules.insert(paths.rules.begin() + std::ptrdiff_t(i), parse_path_rule(texts[i]));
            },
            "where files lie on this machine: names in the scene that begin with the folder FROM are read "
            "from TO; the longest FROM counts")
        ->type_name("FROM=TO")
        ->allow_extra_args(false);
    command
        .add_option_function<Texts>(
            "--map-file",
            [&paths](const Texts& files) {
                for (const std::string& file : files)
                    for (PathRule& rule : read_path_rules(file)) paths.rules.push_back(std::move(rule));
            },
            "such mappings from a file, OpenJD's pathmapping-1.0 (JSON)")
        ->type_name("FILE")
        ->allow_extra_args(false);
}

void add_pack_options(CLI::App& command, PackOptions& options) {
    command
        .add_option(
            "-o,--output", options.output,
            "folder to be made: the scene, with the values of --set, and its files in files/; it renders "
            "to the same bits wherever it lies")
        ->required()
        ->type_name("DIR");
    command.add_flag("--states", options.states, "also the states that simulations have left (--state)");
}

} // namespace marram
