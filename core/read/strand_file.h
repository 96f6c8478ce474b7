// SPDX-License-Identifier: Apache-2.0
// Reads strands and guides groomed in other programs, with all their attributes: .hair, .usda, .ply, .obj.
//
// To add a format: its extension in core/math/file_types.h, its read_<format>_strands() here and in a file of its own, and
// a branch in load_strand_file().
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// CVs and widths at one frame, of all curves in sequence.
struct StrandSample {
    double frame = 0.0;
    std::vector<Vec3f> points;
    std::vector<float> widths; // diameters, m; empty if the file has none
};

struct StrandFile {
    std::vector<uint32_t> counts; // CVs of each curve, 2 or more
    // Basis of the CVs; MARRAM_LINEAR: the file has points only.
    MarramBasis basis = MARRAM_LINEAR;
    std::vector<StrandSample> samples; // one, or two or more by ascending frame if the file animates
    std::vector<AttributeValues>
        attributes; // per curve or per CV, in the file's order; animated ones: the first sample
    // m: largest distance of the curves with these CVs from the file's, measured at 7 points per segment.
    double deviation = 0.0;
    std::vector<std::string> warnings; // ignored features of the file; without its name
    // Of a file whose strands or CV counts change over time: its strands at each of its times,
    // samples[0].frame, ascending; any of them may have no strands. All have the same attributes. The other
    // fields are those of the first.
    std::vector<StrandFile> takes;
};

struct StrandReading {
    double fps =
        24.0; // frames per second of the scene, for files with times in seconds or a rate of their own
    std::vector<std::string>
        prims{}; // of a .usda, as of find_usda_curves(); empty: all that are meant to be seen
    uint32_t cvs_per_strand =
        0; // of a .ply with neither edges nor ids: points of each strand; 0: all are one strand
    bool reverse = false; // the strands of the file run from tip to root
};

// Whole files only: truncated files and counts that do not add up are errors. Throws InputError with line and
// column, or byte. Memory: a small multiple of the file; counts in a header are checked against the file's
// size before memory is allocated. Strands of fewer than two points are removed, with a warning that counts
// them. Closed curves are opened: they end where they begin.
StrandFile load_strand_file(const std::string& file, const StrandReading& reading);

// Cem Yuksel's HAIR; metres, y up. Thickness is the diameter at each CV. Writers that do not know the
// thickness leave the header's default at 1: then there are no widths. Attributes: color (3) and transparency
// (1) per CV, or per curve if only the header has them and they differ from 1 1 1 and 0. Cost: less than
// twice that of copying the file.
StrandFile read_hair_strands(const std::string& file);

// The BasisCurves of a USD layer (usda_curves.h). Pinned B-splines and pinned Catmull-Rom curves are kept as
// they are, unless the prims of a file have different bases: then all become Catmull-Rom curves. Other cubics become Catmull-Rom curves through their joints, or through 2, 4 or 8 points per
// cubic, until the error is within a thousandth of each curve's length; around a corner CVs are closer
// (usda_cvs.h). What stays beyond that is a warning. Several prims are merged; attributes that one lacks are 0 there. Points of a prim without a transform are bit-identical.
//   widths, primvars:widths    diameters. Without an interpolation: per vertex, or whichever their number fits
//   normals, primvars:normals  "normal"
//   ids, primvars:id           "id"
//   primvars:NAME              "NAME"; "st" that is uniform is "root_uv". Types: half, float, double, bool
//                              and integers, 1 to 4 of them, with or without indices. Constant and uniform
//                              become per curve, varying and vertex per CV. Integers are discrete; beyond
//                              2^24 they are hashed to 24 bits. Points, vectors and normals are transformed
//                              with their prim.
//   curveVertexCounts          that change over time, or numbers of points: StrandFile::takes
//   time samples               of points, widths and transforms: frame = time * fps / timeCodesPerSecond.
//                              Rotating transforms get more samples in between, so that linear motion is
//                              within a thousandth of the curves' size.
StrandFile read_usda_strands(const std::string& file, std::string_view bytes, const StrandReading& reading);

// The curves of a PLY file as in polylines.h, with all other scalar properties.
//   per vertex: width, thickness (diameters) or radius; nx ny nz "normal"; s t or u v "uv"; red green blue
//     "color" and alpha "alpha", integers as fractions of their type's maximum; NAME_0, NAME_1, ... up to
//     four of them "NAME"; others by their names. Integers are discrete.
//   an element "strand" or "curve", one entry per curve: the same per curve, "uv" as "root_uv". Its strand_id
//     or curve_id, if it has one, names the curve of an entry; else entries are in the order of the curves.
StrandFile read_ply_strands(const std::string& file, std::string_view bytes,
                            const StrandReading& reading = {});

// The l elements of a Wavefront OBJ.
StrandFile read_obj_strands(const std::string& file, std::string_view bytes);

// Shared by the readers.

// Integers that a float would round are hashed to 24 bits: equal numbers give equal values.
inline constexpr int64_t max_whole = int64_t(1) << 24;
float integer_to_float(int64_t value, uint64_t& folded); // folded: their count

// Turns every strand round, with all its values per CV.
void reverse_strands(StrandFile& strands);

// Removes curves of fewer than two CVs, with all their values, and warns. Throws InputError if none is left.
void remove_short_curves(const std::string& file, StrandFile& strands);

} // namespace marram
