// SPDX-License-Identifier: Apache-2.0
// Which procedural libraries a scene names: what its schema is put together from, so it is asked before
// load_scene(). And where libraries are looked for.
#pragma once

#include "core/math/problem.h"

#include <string>
#include <vector>

namespace marram {

struct LibraryName {
    std::string path; // as it can be opened
    Place place;
};

// The `library` of every [[procedural]] that has one, each path once, in the file's order; settings count. A
// file that cannot be parsed throws InputError; everything else that is wrong is left for load_scene() to
// say.
std::vector<LibraryName> scene_libraries(const std::string& file, const std::vector<std::string>& settings);

// Where libraries lie that are named without a folder: the folders in MARRAM_PLUGIN_PATH, separated by colons, then the program's own,
// then the one that `cmake --install` puts them into.
std::vector<std::string> plugin_folders();

// The file of a library that a scene in `folder` names: relative to that folder, or else, for a name without a folder, the first in
// plugin_folders(). The former where there is none of them.
std::string library_path(const std::string& folder, const std::string& name);

} // namespace marram
