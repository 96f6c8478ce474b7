// SPDX-License-Identifier: Apache-2.0
// Loads the [[mesh]] and [[curves]] tables of a scene file. Types and parameters: core/scene/schema.cpp.
#pragma once

#include "core/geometry/scene_curves.h"
#include "core/geometry/scene_mesh.h"
#include "core/math/problem.h"
#include "core/scene/description.h"

#include <atomic>
#include <string>
#include <utility>
#include <vector>

namespace marram {

// The files of a mesh of type "file" or of curves of type "strands", with their frames: one per frame if
// file_frames is given.
std::vector<std::pair<double, std::string>> numbered_files(const Item& item);

// Throws InputError, with the place of the table if the error is not in a file. Adds one line to `warnings`
// for each fault of a file that is corrected or may be one, such as holes of heights or sides that disagree.
Mesh load_scene_mesh(const Item& item, std::vector<Problem>& warnings);

// Loads a [[curves]] table. fps: frames per second, for strand files with times. Adds one line to `warnings`
// for each feature of such files that is ignored. Throws InputError for curves of fewer than 2 points.
SceneCurves load_scene_curves(const Item& item, double fps, const std::atomic<bool>& cancel,
                              std::vector<Problem>& warnings);

// All shapes of a deforming mesh; empty for a rigid one. `first` is the mesh of its first file.
std::vector<MeshShape> load_shapes(const Item& item, const Mesh& first, const std::atomic<bool>& cancel);

} // namespace marram
