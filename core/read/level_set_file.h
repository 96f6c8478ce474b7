// SPDX-License-Identifier: Apache-2.0
// Writes surfaces as OpenVDB's level sets. mesh_reader.h reads them.
#pragma once

#include "core/geometry/world.h"

#include <string>

namespace marram {

// A closed mesh at the first motion sample as an OpenVDB level set: a narrow band of three voxels on either side. The
// voxels are as large as two triangles on average, and at most a hundredth of the mesh. Attributes are left out. The
// file has a random identifier. Throws InputError if the mesh is not closed, needs voxels below 0.02 mm, or is more than
// 2^17 voxels from the origin.
void write_level_set(const std::string& path, const MeshGeometry& mesh);

// True if the mesh encloses a volume: each edge is in as many triangles one way as the other. Vertices in the
// same place count as one.
bool is_closed(const MeshGeometry& mesh);

} // namespace marram
