// SPDX-License-Identifier: Apache-2.0
// Curves of the scene that procedurals use: drawn polylines, and strands and guides groomed in other
// programs.
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/geometry/curve_layout.h"
#include "core/math/transform.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Vertices at a frame.
struct CurvesSample {
    double frame = 0.0;
    std::vector<float> vertices; // as SceneCurves::vertices
};

// Strands from one frame to the next take, of curves that change in number.
struct CurvesTake {
    double frame = 0.0;
    std::vector<uint64_t> offsets; // as SceneCurves
    std::vector<float> vertices;
    std::vector<AttributeValues> attributes;
};

struct SceneCurves {
    std::string name;
    MarramBasis basis = MARRAM_LINEAR; // of strands: as in the file; MARRAM_LINEAR: the file does not say
    std::vector<uint64_t> offsets{0};  // of each curve's first point, and the total
    std::vector<float>
        vertices; // 4 per vertex, as in MarramCurves, before the transform; radius 0: unknown width
    std::vector<uint32_t> closed;              // [curve]
    std::vector<AttributeValues> attributes{}; // per curve or per CV
    // Of animated curves: two or more, by ascending frame. Vertices are linear between them, and constant
    // before the first and after the last. `vertices` are the first's.
    std::vector<CurvesSample> samples{};
    KeyedTransform transform{};
    // Of curves that change in number: by ascending frame. `offsets`, `vertices`, `closed` and `attributes`
    // are those of the take that was selected last, which does not move; `samples` are empty.
    std::vector<CurvesTake> takes{};

    // Selects the take of a frame: the last that begins up to it, or the first. True if that changes the
    // curves.
    bool select_take(double frame);

    void add(std::span<const Vec3d> points, bool is_closed); // 2 points or more, radius 0
    CurveLayout layout() const { return {closed.size(), 0, offsets.data()}; }
    bool is_in_world() const { // at every frame the transform is the identity
        return !transform.moves() && transform.at(0.0).matrix() == Eigen::Affine3d::Identity().matrix();
    }
    bool moves() const { return transform.moves() || samples.size() > 1; } // false: the same at every frame
    bool moves_within(double begin, double end) const;
    // Frames between the two at which the path of a vertex may bend: those of samples and of the transform's
    // keys. Ascending.
    std::vector<double> bends_within(double begin, double end) const;
    // Vertices of some curves in world space; radii are scaled by the cube root of the volume scale.
    // Bit-identical to `vertices` if nothing moves or is transformed.
    void vertices_at(double frame, uint64_t first_curve, uint64_t count, float* out) const;
    std::vector<float> vertices_at(double frame) const;
    uint64_t digest() const; // of all members but the name
};

// Attributes of curves, without values, by the curves' name.
std::map<std::string, std::vector<AttributeValues>> attributes_of(std::span<const SceneCurves> curves);

} // namespace marram
