// SPDX-License-Identifier: Apache-2.0
// The keys that settings change (`--set KEY=VALUE`), of a scene or of any.
#pragma once

#include "core/scene/description.h"

#include <string>
#include <vector>

namespace marram {

// Those that every scene has, sorted: "fps", "camera.position", "film.samples", "wind.speed".
std::vector<std::string> keys_of_tables(const Schema& schema);

// Those of a scene, sorted: also "procedural.grass.length", and of its lists the elements that are there, "wind.gusts.control[0].shape".
std::vector<std::string> keys_of_scene(const SceneDescription& description, const Schema& schema);

} // namespace marram
