// SPDX-License-Identifier: Apache-2.0
// Writes grids of a mesh, such as a terrain's, and its surface to files for other programs.
#pragma once

#include "core/geometry/world.h"

#include <optional>
#include <string>

namespace marram {

// The extension of `path` selects the format. Row 0 is the first row of samples. All formats have the
// metadata of grid_placement.h, by which an image layer puts pixels back on the samples, and nothing that
// differs between runs. Throws InputError if the mesh has no grid of heights or the file cannot be written.
//   .exr        all 2D scalar grids with as many samples as the first, 32-bit floats: the first as
//               channel Y, for readers of a single channel, and all by name, "grid.sand"
//   .tif .tiff  the first grid, a terrain's height, 32-bit floats in metres, not compressed
//   .png        the same in 16 bits: 0 is the lowest sample, 65535 the highest, or the heights of `range` (low,
//               high); marram:range_low and range_high give these heights. Rounded to nearest: the error is at most
//               half a step. Heights outside the range are clamped
// Returns the number of samples that were clamped.
size_t write_grids(const std::string& path, const MeshGeometry& mesh, const std::optional<Vec2d>& range = {});

// The lowest and the highest sample of the first grid of a mesh that has one.
Vec2d height_range(const MeshGeometry& mesh);

// Binary little-endian PLY of a mesh at the first motion sample: positions, normals, uvs (s, t), every
// attribute per vertex or face as floats, faces as vertex_indices. Attribute names are made identifiers;
// several components get _0, _1, ...
void write_surface_ply(const std::string& path, const MeshGeometry& mesh);

} // namespace marram
