// SPDX-License-Identifier: Apache-2.0
// The procedural libraries that a scene names, and where they are searched. The schema is made from the
// libraries, so they are found before load_scene() is called.
#pragma once

#include "core/math/problem.h"

#include <string>
#include <vector>

namespace marram {

struct LibraryName {
    std::string path; // to open it
    Place place;
};

// The `library` of every [[procedural]] that has one, after applying `settings`; each path once, in the order
// of the file. Throws InputError if the file cannot be parsed. All other mistakes are left to load_scene().
std::vector<LibraryName> scene_libraries(const std::string& file, const std::vector<std::string>& settings);

// Search path of libraries that are named without a folder: the folders in MARRAM_PLUGIN_PATH, separated by
// colons, then the folder of the program, then the one that `cmake --install` uses.
std::vector<std::string> plugin_folders();

// The file of a library that a scene in `folder` names: relative to that folder or, if there is no such file
// and the name has no folder, the first found in plugin_folders(). If none exists, the path relative to
// `folder`.
std::string library_path(const std::string& folder, const std::string& name);

} // namespace marram
