// SPDX-License-Identifier: Apache-2.0
// Whether materials mean something where they are used.
#pragma once

#include "core/shot/shot.h"

namespace marram {

// Throws InputError for a shader of strands on a mesh, and for a tint or blend by an attribute that what the material is on does not
// carry. Returns warnings: sand on a mesh that moves.
std::vector<std::string> check_materials(const Shot& shot);

// Throws InputError where a material of strands has an image, and what a procedural made for them to stand on has no uvs.
void check_root_uvs(const Shot& shot, const World& world);

} // namespace marram
