// SPDX-License-Identifier: Apache-2.0
// Baked curves and meshes in files that other programs read. What is written are the CVs themselves, without
// the phantom vertices at both ends, at the first motion sample. Files appear whole or not at all
// (core/image/atomic_file.h). All throw InputError where the file cannot be written or cannot hold what it is
// given.
//
// To add a format, write one function here and name its extension in write_curves().
#pragma once

#include "core/geometry/export_text.h"
#include "core/geometry/world.h"

#include <set>
#include <span>
#include <string>
#include <vector>

namespace marram {

// By the extension of `path`: .hair, .usda, .ply or .obj.
void write_curves(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// Cem Yuksel's HAIR: all geometries one after the other, thickness (the diameter) at each point. Binary
// floats: exact. Holds up to 65,536 CVs a curve and 2^32 - 1 curves and points. Cost: 0.3 s for a million
// curves of 8 CVs.
void write_hair(const std::string& path, std::span<const CurveGeometry> curves);

// USD as text: a BasisCurves for each geometry, of type "cubic" and wrap "pinned", which adds the same
// phantom points as Marram does and allows 2 CVs. Widths by vertex; attributes as primvars, discrete ones (id) as
// whole numbers; an id for each curve as ids, too; ribbons that carry normals as normals by vertex. Numbers in the
// fewest digits that give the same float back. Memory: a copy of the largest of these arrays.
void write_usda(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// The same over several frames in one file: what changes as time samples, whose times are the frames; what does not as
// one value; velocities of the points in metres a second, by the parabola through the frames before and behind (central
// differences where they are equally far apart), at both ends by the difference. Memory: of a frame the arrays, its
// points and those of the frame before, whatever the number of frames; samples wait in files beside the target that are
// removed in the end: twice its size for that time.
class UsdaSequence {
  public:
    UsdaSequence(std::string path, double fps); // check_writable(path)
    ~UsdaSequence();
    UsdaSequence(const UsdaSequence&) = delete;
    UsdaSequence& operator=(const UsdaSequence&) = delete;
    // Frames ascend. Throws InputError where there are other curves or CVs than in the frames before.
    void add(std::span<const CurveGeometry> curves, double frame);
    void commit(); // once, after a frame or more

  private:
    struct Curves;
    void add_curves(const CurveGeometry& geometry, Curves& curves, double frame);
    void add_velocities(Curves& curves);
    [[noreturn]] void refuse_change(const std::string& name, double frame) const;

    std::string path_;
    double fps_;
    ExportText text_;
    std::vector<double> frames_;
    std::vector<Curves> curves_;
    std::set<std::string> taken_; // names of prims
};

// PLY, binary, little endian: the CVs of all geometries as vertices x y z width strand_id, normals of ribbons, and attributes at CVs as
// properties; an element "strand" with strand_id and attributes of curves. Vectors as NAME_0, NAME_1, ...; discrete values as int. What a
// geometry lacks is 0. Exact.
void write_curves_ply(const std::string& path, std::span<const CurveGeometry> curves);

// Wavefront OBJ: an object of `l` polylines for each geometry. Widths are lost.
void write_curves_obj(const std::string& path, std::span<const CurveGeometry> curves);

// Meshes at the first motion sample, in world space, with uvs and normals where they have them; as USD with their attributes as
// primvars.
void write_colliders_usda(const std::string& path, std::span<const MeshGeometry> meshes, double frame,
                          double fps);
void write_colliders_obj(const std::string& path, std::span<const MeshGeometry> meshes);

} // namespace marram
