// SPDX-License-Identifier: Apache-2.0
// Writes baked curves and meshes to files for other programs. Curves are written as their CVs at the first
// motion sample, without the phantom vertices at both ends. Files appear whole or not at all
// (core/image/atomic_file.h). All functions throw InputError if the file cannot be written or its format
// cannot hold the data.
//
// To add a format, write one function here and name its extension in write_curves().
#pragma once

#include "core/geometry/world.h"
#include "core/write/export_text.h"

#include <set>
#include <span>
#include <string>
#include <vector>

namespace marram {

// The extension of `path` selects the format: .hair, .usda, .ply or .obj.
void write_curves(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// Cem Yuksel's HAIR: all geometries in sequence, with the thickness (diameter) at each point. Binary floats,
// so exact. At most 65,536 CVs per curve and 2^32 - 1 curves and points. Cost: 0.3 s for a million curves of
// 8 CVs.
void write_hair(const std::string& path, std::span<const CurveGeometry> curves);

// USD text: one BasisCurves per geometry, of type "cubic" and wrap "pinned", which adds the same phantom
// points as Marram and allows 2 CVs. Widths are per vertex. Attributes become primvars, discrete ones with
// integers; an id per curve is also written as ids. Ribbons with normals have them per vertex. Numbers have
// the fewest digits that restore the same float. Memory: a copy of the largest of these arrays.
void write_usda(const std::string& path, std::span<const CurveGeometry> curves, double frame, double fps);

// The same for several frames in one file. What changes becomes time samples, with frames as times; the rest
// has one value. Point velocities are in m/s: the derivative of the parabola through the previous, this and
// the next frame (central differences at equal spacing), one-sided differences at both ends. Memory: one
// frame's arrays, its points and those of the previous frame, for any number of frames. Samples wait in files
// beside the target, which are removed at the end; until then the disk holds twice the target's size.
class UsdaSequence {
  public:
    UsdaSequence(std::string path, double fps); // check_writable(path)
    ~UsdaSequence();
    UsdaSequence(const UsdaSequence&) = delete;
    UsdaSequence& operator=(const UsdaSequence&) = delete;
    // Frames must ascend. Throws InputError if curves or CVs are not those of the frames before.
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

// Binary little-endian PLY. The CVs of all geometries are vertices with x y z width strand_id, normals of
// ribbons and attributes per CV. An element "strand" has strand_id and attributes per curve. Vectors become
// NAME_0, NAME_1, ...; discrete values are int. An attribute that a geometry lacks is 0 there. Exact.
void write_curves_ply(const std::string& path, std::span<const CurveGeometry> curves);

// Wavefront OBJ: one object with `l` polylines per geometry. Widths are lost.
void write_curves_obj(const std::string& path, std::span<const CurveGeometry> curves);

// Meshes at the first motion sample in world space, with uvs and normals if they have them. USD also has
// their attributes as primvars.
void write_colliders_usda(const std::string& path, std::span<const MeshGeometry> meshes, double frame,
                          double fps);
void write_colliders_obj(const std::string& path, std::span<const MeshGeometry> meshes);

} // namespace marram
