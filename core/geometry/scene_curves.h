// SPDX-License-Identifier: Apache-2.0
// Curves of the scene that procedurals use: polylines that were drawn, strands and guides that were groomed elsewhere.
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

struct SceneCurves {
    std::string name;
    MarramBasis basis = MARRAM_LINEAR; // of strands: how the file draws them; MARRAM_LINEAR: it does not say
    std::vector<uint64_t> offsets{0};  // of each curve's first point, and behind the last
    std::vector<float>
        vertices; // 4 a vertex, as in MarramCurves, before the transform; radius 0: no width is known
    std::vector<uint32_t> closed;              // [curve]
    std::vector<AttributeValues> attributes{}; // per curve or per CV
    // Of curves that animate, by ascending frame, two or more. From each to the next vertices go straight; before the first and after
    // the last they rest. `vertices` are the first's.
    std::vector<CurvesSample> samples{};
    KeyedTransform transform{};

    void add(std::span<const Vec3d> points, bool is_closed); // 2 points or more, radius 0
    CurveLayout layout() const { return {closed.size(), 0, offsets.data()}; }
    bool is_in_world() const { // at every frame the transform leaves them where they are
        return !transform.moves() && transform.at(0.0).matrix() == Eigen::Affine3d::Identity().matrix();
    }
    bool moves() const { return transform.moves() || samples.size() > 1; } // false: the same at every frame
    bool moves_within(double begin, double end) const;
    // Frames between the two at which the way of a vertex may bend: of its samples, and of its transform's keys. Ascending.
    std::vector<double> bends_within(double begin, double end) const;
    // Vertices of some curves in the world; radii are scaled as the cube root of what volumes are. Where nothing moves or is transformed: `vertices`, to the bit.
    void vertices_at(double frame, uint64_t first_curve, uint64_t count, float* out) const;
    std::vector<float> vertices_at(double frame) const;
    uint64_t digest() const; // of all that it holds but its name
};

// What curves carry, by their name: attributes without values.
std::map<std::string, std::vector<AttributeValues>> attributes_of(std::span<const SceneCurves> curves);

} // namespace marram
