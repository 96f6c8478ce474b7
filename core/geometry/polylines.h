// SPDX-License-Identifier: Apache-2.0
// Polylines from files.
#pragma once

#include "core/math/vec.h"

#include <string>
#include <vector>

namespace marram {

// The l elements of an .obj file. Throws InputError where there are none, and for indices and numbers that are not usable.
std::vector<std::vector<Vec3d>> load_polylines(const std::string& file);

} // namespace marram
