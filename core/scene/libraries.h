// SPDX-License-Identifier: Apache-2.0
// The procedural libraries that a scene names, and where they are searched. The schema is made from the
// libraries, so they are found before load_scene() is called.
#pragma once

#include "core/math/problem.h"
#include "core/scene/path_map.h"

#include <string>
#include <vector>

namespace marram {

struct LibraryName {
    std::string path; // to open it
    Place place;
    bool allowed = false; // it may be loaded: is_allowed_library()
};

// The `library` of every [[procedural]] that has one, after applying `settings`; each path once, in the order
// of the file. Throws InputError if the file cannot be parsed. All other mistakes are left to load_scene().
// allowed: libraries that the user has allowed by name. paths: as of load_scene(); a path that it leads to
// needs the same permission as any other.
std::vector<LibraryName> scene_libraries(const std::string& file, const std::vector<std::string>& settings,
                                         const std::vector<std::string>& allowed = {},
                                         const PathMap& paths = {});

// Search path of libraries that are named without a folder: the folders in MARRAM_PLUGIN_PATH, separated by
// colons, then the folder of the program, then the one that `cmake --install` uses.
std::vector<std::string> plugin_folders();

// Whether a library may be loaded. Its code runs with the user's rights, and a scene may come from anywhere.
// So it must lie in one of plugin_folders() (links resolved, and not in a folder below) or be one of
// `allowed`.
bool is_allowed_library(const std::string& path, const std::vector<std::string>& allowed);

// The file of a library that a scene in `folder` names: relative to that folder or, if there is no such file
// and the name has no folder, the first found in plugin_folders(). If none exists, the path relative to
// `folder`.
std::string library_path(const std::string& folder, const std::string& name);

} // namespace marram
