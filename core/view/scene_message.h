// SPDX-License-Identifier: Apache-2.0
// The message "scene": all that a page needs to know of the scene but its geometry.
#pragma once

#include "core/shot/shot.h"

#include <nlohmann/json.hpp>

#include <map>
#include <string>

namespace marram {

// Values that differ from the file's, by key: as --set takes them.
using ChangedValues = std::map<std::string, std::string>;

// What the page asks for, in groups: the scene, camera, film, wind, and each light, material, mesh, curves
// and procedural that has a name.
nlohmann::json parameter_groups(const Shot& shot, const ChangedValues& changed);

nlohmann::json camera_message(const Shot& shot, double frame);

// "problems": none clears those that are shown.
nlohmann::json problems_message(const std::vector<Problem>& problems);

} // namespace marram
