// SPDX-License-Identifier: Apache-2.0
#include "core/scene/libraries.h"
#include "core/scene/parse.h"
#include "core/scene/suggest.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>

namespace marram {

namespace fs = std::filesystem;

std::vector<std::string> plugin_folders() {
    std::vector<std::string> folders;
    if (const char* path = std::getenv("MARRAM_PLUGIN_PATH"))
        for (std::string& folder : split(path, ':'))
            if (!folder.empty()) folders.push_back(std::move(folder));
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error).parent_path();
    if (error) return folders;
    folders.push_back(program.string());
    folders.push_back((program / MARRAM_PLUGIN_FOLDER).lexically_normal().string());
    return folders;
}

std::string library_path(const std::string& folder, const std::string& name) {
    const fs::path own = fs::path(folder) / name;
    std::error_code error;
    if (fs::exists(own, error) || name.find('/') != std::string::npos) return own.string();
    for (const std::string& other : plugin_folders())
        if (const fs::path path = fs::path(other) / name; fs::exists(path, error)) return path.string();
    return own.string();
}

bool is_allowed_library(const std::string& path, const std::vector<std::string>& allowed) {
    std::error_code error;
    const auto same = [&](const fs::path& a, const fs::path& b) { return fs::equivalent(a, b, error); };
    const fs::path file = fs::absolute(path, error), behind_links = fs::weakly_canonical(file, error);
    for (const std::string& folder : plugin_folders())
        if (same(file.parent_path(), folder) || same(behind_links.parent_path(), folder)) return true;
    return std::any_of(allowed.begin(), allowed.end(),
                       [&](const std::string& one) { return same(file, one); });
}

std::vector<LibraryName> scene_libraries(const std::string& file, const std::vector<std::string>& settings,
                                         const std::vector<std::string>& allowed, const PathMap& paths) {
    Reading reading;
    reading.file = file;
    toml::table root = parse_scene(reading);
    apply_settings(root, settings, reading);
    std::vector<LibraryName> libraries;
    const toml::array* procedurals = root.get("procedural") ? root.get("procedural")->as_array() : nullptr;
    for (size_t i = 0; procedurals && i < procedurals->size(); ++i) {
        const toml::table* table = procedurals->get(i)->as_table();
        const toml::node* node = table ? table->get("library") : nullptr;
        if (!node || !node->is_string()) continue;
        const std::string path =
            library_path(fs::path(file).parent_path().string(), paths.apply(node->as_string()->get()));
        const bool is_new = std::none_of(libraries.begin(), libraries.end(),
                                         [&](const LibraryName& library) { return library.path == path; });
        if (is_new) libraries.push_back({path, place_of(*node, reading), is_allowed_library(path, allowed)});
    }
    return libraries;
}

} // namespace marram
