// SPDX-License-Identifier: Apache-2.0
// What no single value can say: rules between the values of a scene.
//
// To add a rule: a function in rules.cpp that reports, called from check_rules().
#pragma once

#include "core/scene/reading.h"

namespace marram {

// Things that have a name, with the place of the name; also of those that are wrong otherwise, so that a
// reference to one of them is not a second mistake. A mesh and a procedural cannot share a name: both stand
// in the world.
struct Name {
    std::string kind; // "material", "mesh", ...
    std::string name;
    Place place;
};

void check_names(const std::vector<Name>& names, Reading& reading);

// References, whole numbers in ranges, the camera, suns, tolerances, mesh files. Values that are wrong by
// themselves are absent from the sets.
void check_rules(const SceneDescription& scene, const std::vector<Name>& names, Reading& reading);

} // namespace marram
