// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/read/velocity_file.h"

#include <string>

namespace marram {

// See read_velocities(). Frees the bytes.
VelocityGrid read_velocity_grid(const std::string& path, const std::string& name, std::string& bytes);

} // namespace marram
