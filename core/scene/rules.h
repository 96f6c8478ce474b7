// SPDX-License-Identifier: Apache-2.0
// Rules between the values of a scene, which the check of a single value cannot cover.
//
// To add a rule: write a function in rules.cpp that reports, and call it from check_rules().
#pragma once

#include "core/scene/reading.h"

namespace marram {

// The name of an item and its place. Items with other mistakes are included, so that a reference to one of
// them is not reported as another mistake. Meshes, curves and procedurals share one name space.
struct Name {
    std::string kind; // "material", "mesh", ...
    std::string name;
    Place place;
};

void check_names(const std::vector<Name>& names, Reading& reading);

// Checks references, whole numbers in ranges, the camera, suns, tolerances, mesh and strand files. Values
// that failed their own check are absent from the sets.
void check_rules(const SceneDescription& scene, const std::vector<Name>& names, Reading& reading);

} // namespace marram
