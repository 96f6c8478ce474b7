// SPDX-License-Identifier: Apache-2.0
#include "core/scene/libraries.h"
#include "core/scene/parse.h"

#include <algorithm>
#include <filesystem>

namespace marram {

std::vector<LibraryName> scene_libraries(const std::string& file, const std::vector<std::string>& settings) {
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
        const std::string& text = node->as_string()->get();
        const std::string path = (std::filesystem::path(file).parent_path() / text).string();
        const bool is_new = std::none_of(libraries.begin(), libraries.end(),
                                         [&](const LibraryName& library) { return library.path == path; });
        if (is_new) libraries.push_back({path, place_of(*node, reading)});
    }
    return libraries;
}

} // namespace marram
