// SPDX-License-Identifier: Apache-2.0
// Images of environment lights.
#pragma once

#include "core/math/problem.h"
#include "core/render/lights/light_type.h"

#include <string>
#include <vector>

namespace marram {

// The reader of images for light_types(). It adds to `warnings`.
LightImageReader light_image_reader(std::vector<Problem>& warnings);

} // namespace marram
