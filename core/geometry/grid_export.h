// SPDX-License-Identifier: Apache-2.0
// Grids of a mesh, such as a terrain's, in files that other programs read; and its surface.
#pragma once

#include "core/geometry/world.h"

#include <string>

namespace marram {

// By the extension of `path`. Row 0 is the first row of samples. All carry the metadata of grid_placement.h, which put an image layer's
// pixels back on the samples, and nothing that differs from run to run. Throws InputError where the mesh has no such grid or the file
// cannot be written.
//   .exr        every two-dimensional grid of the mesh that has as many samples as the first one, 32-bit floats: the first as channel Y, so
//               that whoever reads one channel reads it, and all by name, "grid.sand"
//   .tif .tiff  the first grid, a terrain's height, 32-bit floats in metres, not compressed
//   .png        the same in 16 bits: 0 is its lowest sample, 65535 its highest, as marram:range_low and range_high say; rounded to the
//               nearest, so that it is off by half a step at most
void write_grids(const std::string& path, const MeshGeometry& mesh);

// A mesh at the first motion sample as binary PLY, little endian: positions, normals, uvs (s, t), every attribute of a vertex or a face as
// floats by its name, names made identifiers, those of several components with _0, _1, ...; faces as vertex_indices.
void write_surface_ply(const std::string& path, const MeshGeometry& mesh);

} // namespace marram
