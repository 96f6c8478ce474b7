// SPDX-License-Identifier: Apache-2.0
// Which procedural libraries a scene names: what its schema is put together from, so it is asked before
// load_scene().
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

} // namespace marram
