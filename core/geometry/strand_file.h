// SPDX-License-Identifier: Apache-2.0
// Strands and guides that were groomed elsewhere, with all that their file carries: .hair, .usda, .ply, .obj.
//
// To add a format, write its read_<format>_strands() here and name its extension in load_strand_file().
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// CVs and widths at one frame, for all curves one after the other.
struct StrandSample {
    double frame = 0.0;
    std::vector<Vec3f> points;
    std::vector<float> widths; // diameters, m; empty where the file has none
};

struct StrandFile {
    std::vector<uint32_t> counts; // CVs of each curve, 2 or more
    // How the CVs are drawn; MARRAM_LINEAR: the file says nothing but points.
    MarramBasis basis = MARRAM_LINEAR;
    std::vector<StrandSample> samples; // one, or by ascending frame two or more where the file animates
    std::vector<AttributeValues>
        attributes; // per curve or per CV, in the file's order; of an animated one its first sample
    double deviation =
        0.0; // m: how far the curve that is drawn from these CVs is from the file's, at most (7 points a segment are looked at)
    std::vector<std::string> warnings; // features of the file that were ignored; without its name
};

// Whole files only: one that is cut, or whose counts do not add up, is an error. fps: frames a second of the scene, for files that
// count time in seconds or have a rate of their own. Throws InputError with line and column, or byte. Memory: a small multiple of the
// file; none is taken for a count in a header before the bytes are known to be there. Strands of fewer than two points are left out, with a
// warning that counts them (of USD they are an error, as USD has none). What is closed is opened: it ends where it begins.
StrandFile load_strand_file(const std::string& file, double fps);

// Cem Yuksel's HAIR; metres, y up. Thickness is the diameter at each CV. Writers that know no thickness leave the header's default at 1:
// then there are no widths. Attributes: color (3) and transparency (1) at each CV, or for each curve where the header alone has
// them and they are not 1 1 1 and 0. Cost: less than twice that of copying the file.
StrandFile read_hair_strands(const std::string& file);

// The BasisCurves of a USD layer (usda_curves.h). Pinned B-splines and pinned Catmull-Rom curves are taken as they are; of all other
// cubics Catmull-Rom curves through their joints, or through 2, 4 or 8 points a cubic, until they keep to a thousandth of each curve's
// length (usda_cvs.h). Several prims become one file: what one of them lacks is 0 there. Points of a prim without a transform are kept to the bit.
//   widths, primvars:widths    diameters
//   normals, primvars:normals  "normal"
//   ids, primvars:id           "id"
//   primvars:NAME              "NAME"; "st" that is uniform is "root_uv". Of half, float, double, bool and whole numbers, 1 to 4 of them,
//                              with or without indices; constant and uniform for each curve, varying and vertex at each CV. Whole
//                              numbers are discrete; beyond 2^24 they are folded into 24 bits. Types of points, vectors and normals are
//                              placed with their prim.
//   time samples               of points, widths and transforms: frame = time * fps / timeCodesPerSecond. Between those of a transform
//                              that turns there are more, so that straight ways keep to a thousandth of the curves' size.
StrandFile read_usda_strands(const std::string& file, std::string_view bytes, double fps);

// The curves of a PLY file as polylines.h has them, with all other scalar properties.
//   of a vertex: width, thickness (diameters) or radius; nx ny nz "normal"; s t or u v "uv"; red green blue "color" and alpha "alpha", 1
//     for the greatest of a whole type; NAME_0, NAME_1, ... up to four of them "NAME"; others by their names. Whole ones are discrete.
//   of an element "strand" or "curve", one entry a curve: the same for each curve, "uv" as "root_uv". Its strand_id or curve_id, where it
//     has one, says whose an entry is; else entries stand in the order of the curves.
StrandFile read_ply_strands(const std::string& file, std::string_view bytes);

// The l elements of a Wavefront OBJ.
StrandFile read_obj_strands(const std::string& file, std::string_view bytes);

// What the readers share.

// Whole numbers that a float would round, folded into 24 bits by a hash: the same number always into the same.
inline constexpr int64_t greatest_whole = int64_t(1) << 24;
float whole_as_float(int64_t value, uint64_t& folded); // counts

// Takes out curves of fewer than two CVs, with all their values, and warns. Throws InputError where none is left.
void leave_out_points(const std::string& file, StrandFile& strands);

} // namespace marram
