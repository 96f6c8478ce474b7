// SPDX-License-Identifier: Apache-2.0
// Checks that materials fit the geometry that they are assigned to.
#pragma once

#include "core/shot/shot.h"

namespace marram {

// Throws InputError for a strand shader on a mesh, and for a tint or blend by an attribute that the geometry
// does not have. Returns warnings: sand on a moving mesh.
std::vector<Problem> check_materials(const Shot& shot);

// Throws InputError if a strand material has an image, but the mesh that the strands grow on, made by a
// procedural, has no uvs.
void check_root_uvs(const Shot& shot, const World& world);

// Warnings about images of materials and the unit squares of uv that meshes and strands use: tiles that an
// image lacks, and a single tile ("fur.1001.png") that repeats over other squares.
std::vector<Problem> check_tiles(const Shot& shot, const World& world);

} // namespace marram
