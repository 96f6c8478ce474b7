// SPDX-License-Identifier: Apache-2.0
// Whether materials mean something where they are used.
#pragma once

#include "core/shot/shot.h"

namespace marram {

// Throws InputError for a shader of strands on a mesh, and for a tint by an attribute that no strand with this material carries;
// warns on stderr of sand on a mesh that moves.
std::vector<std::string> check_materials(const Shot& shot);

} // namespace marram
