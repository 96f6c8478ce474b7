// SPDX-License-Identifier: Apache-2.0
// The [[mesh]] tables of a scene file as meshes, and the [[curves]] tables. Types and parameters: core/scene/schema.cpp.
#pragma once

#include "core/geometry/scene_curves.h"
#include "core/geometry/scene_mesh.h"
#include "core/scene/description.h"

#include <atomic>
#include <string>
#include <utility>
#include <vector>

namespace marram {

// The files of a mesh of type "file" or of curves of type "strands", with their frames: one per frame if they deform.
std::vector<std::pair<double, std::string>> numbered_files(const Item& item);

// Throws InputError with the place of the table where no file is to blame.
Mesh load_scene_mesh(const Item& item);

// A [[curves]] table. fps: frames a second, for files of strands with times. Adds to `warnings` what such files hold and is not taken
// over, a line each. Throws InputError for drawn curves of fewer than 2 points.
SceneCurves load_scene_curves(const Item& item, double fps, const std::atomic<bool>& cancel,
                              std::vector<std::string>& warnings);

// All shapes of a mesh that deforms, empty for one that does not. `first` is the mesh of its first file.
std::vector<MeshShape> load_shapes(const Item& item, const Mesh& first, const std::atomic<bool>& cancel);

} // namespace marram
