// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/manual/scene_reference.h"
#include "core/shot/file_summary.h"
#include "core/shot/scene/scene_keys.h"
#include "core/shot/scene/scene_summary.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>

namespace marram {
namespace {

void print_scene(const InfoOptions& asked) {
    CommonOptions options;
    options.scene = asked.subject;
    options.overrides.allowed_libraries = asked.allowed_libraries;
    options.overrides.settings = asked.settings;
    options.overrides.paths = asked.paths;
    Shot shot = open_shot(options);
    print_result("{}", scene_summary(shot, interrupted()));
}

// Reads only the scene file, not the files that it names.
void print_keys(const InfoOptions& asked) {
    PluginSet plugins = default_plugins();
    plugins.allowed = asked.allowed_libraries;
    plugins.paths = asked.paths;
    const std::string& scene = asked.subject;
    const std::vector<std::string> keys =
        scene.empty() ? keys_of_tables(plugins.schema)
                      : keys_of_scene(describe_scene(scene, asked.settings, plugins), plugins.schema);
    for (const std::string& key : keys) print_result("{}\n", key);
}

bool is_scene(const std::string& subject) { return std::filesystem::path(subject).extension() == ".toml"; }

} // namespace

int info_command(const InfoOptions& options) {
    const std::string& subject = options.subject;
    if (!options.settings.empty() && !is_scene(subject))
        throw InputError({"--set " + options.settings.front()}, "there is no scene to change",
                         "name a scene file (.toml)");
    if (!options.paths.rules.empty() && !is_scene(subject))
        throw InputError({"--map " + options.paths.rules.front().from},
                         "there is no scene whose files it maps", "name a scene file (.toml)");
    if (options.keys) {
        if (!subject.empty() && !is_scene(subject))
            throw InputError({"marram info --keys " + subject}, "this is no scene",
                             "name a scene file (.toml), or none");
        print_keys(options);
    } else if (is_scene(subject)) {
        print_scene(options);
    } else if (const std::string file = file_summary(subject); !file.empty()) {
        print_result("{}", file);
    } else {
        const PluginSet plugins = default_plugins();
        const std::string text = reference_text(plugins, subject);
        if (text.empty())
            throw InputError(
                {"marram info " + subject}, "there is no such subject",
                fmt::format(
                    "ask for a scene file (.toml), a file of a mesh, strands or a picture, or one of: {}",
                    fmt::join(reference_subjects(plugins), ", ")));
        print_result("{}", text);
    }
    return exit_done;
}

} // namespace marram
