// SPDX-License-Identifier: Apache-2.0
// Baked curves and meshes in files that other programs read. What is written are the CVs themselves, without
// the phantom vertices at both ends, at the first motion sample. Files appear whole or not at all
// (core/image/atomic_file.h). All throw InputError where the file cannot be written or cannot hold what it is
// given.
//
// To add a format, write one function here and name its extension in write_curves().
#pragma once

#include "core/geometry/world.h"

#include <span>
#include <string>

namespace marram {

// By the extension of `path`: .hair, .usda or .obj.
void write_curves(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// Cem Yuksel's HAIR: all geometries one after the other, thickness (the diameter) at each point. Binary
// floats: exact. Holds up to 65,536 CVs a curve and 2^32 - 1 curves and points. Cost: 0.3 s for a million
// curves of 8 CVs.
void write_hair(const std::string& path, std::span<const CurveGeometry> curves);

// USD as text: a BasisCurves for each geometry, of type "cubic" and wrap "pinned", which adds the same
// phantom points as Marram does and allows 2 CVs. Widths by vertex; attributes as primvars, discrete ones (id) as
// whole numbers; ribbons that carry normals as normals by vertex. Numbers in the fewest digits that
// give the same float back.
void write_usda(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// Wavefront OBJ: an object of `l` polylines for each geometry. Widths are lost.
void write_curves_obj(const std::string& path, std::span<const CurveGeometry> curves);

// Meshes at the first motion sample, in world space, with uvs and normals where they have them; as USD with their attributes as
// primvars.
void write_colliders_usda(const std::string& path, std::span<const MeshGeometry> meshes, double frame,
                          double fps);
void write_colliders_obj(const std::string& path, std::span<const MeshGeometry> meshes);

} // namespace marram
