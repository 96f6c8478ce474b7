// SPDX-License-Identifier: Apache-2.0
// Grids of a mesh, such as a terrain's, in files that other programs read.
#pragma once

#include "core/geometry/world.h"

#include <string>

namespace marram {

// An EXR of 32-bit floats with every two-dimensional grid of the mesh that has as many samples as the first one: that one as channel Y, so
// that whoever reads one channel reads it, and all by name, "grid.sand". Row 0 is the first row of samples. Metadata: marram:cell (metres
// from sample to sample), marram:center_x, marram:center_z and marram:size_x, marram:size_z, which put an image layer's pixels back on the samples.
// Throws InputError where the mesh has no such grid or the file cannot be written.
void write_grids(const std::string& path, const MeshGeometry& mesh);

} // namespace marram
