// SPDX-License-Identifier: Apache-2.0
// The keys that `--set KEY=VALUE` can change.
#pragma once

#include "core/scene/description.h"

#include <string>
#include <vector>

namespace marram {

// The keys of every scene, sorted: "fps", "camera.position", "film.samples", "wind.speed".
std::vector<std::string> keys_of_tables(const Schema& schema);

// The keys of one scene, sorted. They include "procedural.grass.length" and, for the list elements that the
// scene has, "wind.gusts.control[0].shape".
std::vector<std::string> keys_of_scene(const SceneDescription& description, const Schema& schema);

} // namespace marram
