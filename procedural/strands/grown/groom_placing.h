// SPDX-License-Identifier: Apache-2.0
// Where the strands of a groom grow: its mesh, its roots, and their guides.
#pragma once

#include "procedural/strands/grown/groom_instance.h"

#include <cstdint>

namespace marram {

// Sets mesh and attributes. Throws SceneFault if the frame lacks the mesh.
void find_mesh(GroomInstance& instance);

// Images need uvs. Where the mesh has uvs outside the unit square, images repeat unless the groom says
// otherwise.
void prepare_images(GroomInstance& instance);

// Digest of a mesh's topology. If the host gives none, only the counts are compared.
uint64_t topology_digest(const MarramMesh& mesh);

// Keeps the roots if everything that places them is unchanged. On an evolving terrain they are placed again
// in each frame. Whether a strand exists depends on its own hash, so most strands persist between frames.
void invalidate_roots_if_mesh_changed(GroomInstance& instance);

// Places the roots, for the level of detail if there is one; then guides, and blends of them.
void place_strands(GroomInstance& instance);

// With a level of detail: of all roots, some that do not depend on the camera.
void place_sample(GroomInstance& instance);

} // namespace marram
