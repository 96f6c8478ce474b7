// SPDX-License-Identifier: Apache-2.0
// Converts USD curves to CVs: pinned B-splines and pinned Catmull-Rom curves are kept, linear ones connect
// their points, all others become Catmull-Rom curves through the joints of their cubics, or of pieces of
// these. Periodic curves are opened: they end where they begin.
//
// Corners. A Catmull-Rom curve is smooth: near a joint where the file's curve has a corner it leaves the curve by up to
// 0.075 of the distance e between CVs there (a right angle: its tangent at the joint, (e, e) / 2, times the largest value
// 4 / 27 of the Hermite function). Doubling the CV does not help: the curve then overshoots by as much. So CVs lie
// on the corner and at 1/4, 1/16 and 1/64 of a piece on both sides of it: steps of a factor 4 do not overshoot (Fritsch
// and Carlson 1980: tangents of up to 3 chords are monotone, these have 2.5), and the deviation is 0.0012 of the cubic.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "core/read/usda/usda_curves.h"

#include <array>
#include <span>

namespace marram {

class UsdaCvs {
  public:
    // through_points: pinned B-splines become Catmull-Rom curves, too.
    UsdaCvs(UsdaCurveKind kind, std::vector<uint32_t> counts, bool through_points = false);

    MarramBasis basis() const;
    bool keeps_vertices() const { return keeps_vertices_; } // the CVs are the vertices
    void cut(uint32_t pieces); // pieces per cubic; 1 at first. Only if !keeps_vertices()
    // Marks joints with a corner of more than 0.1 radians, for the next cut(). True if there are any. points:
    // of the vertices.
    bool mark_corners(std::span<const double> points);

    size_t curve_count() const { return counts_.size(); }
    size_t vertex_count() const { return vertices_.back(); }
    size_t joint_count() const { return joints_.back(); } // number of "varying" values
    size_t cv_count() const { return cvs_.back(); }
    std::vector<uint32_t> cv_counts() const;

    // Interpolates values of vertices, joints or curves to the CVs, `components` each. Discrete ones are
    // those of the vertex with the largest weight, or of the nearest joint. Cost: 10 ns per CV and processor.
    std::vector<double> of_vertices(std::span<const double> values, size_t components, bool discrete) const;
    std::vector<double> of_joints(std::span<const double> values, size_t components, bool discrete) const;
    std::vector<double> of_curves(std::span<const double> values, size_t components) const;

    struct Deviation {
        double distance = 0.0, share = 0.0; // maxima; share: of a curve's length
    };
    // Distance of the curves with these CVs from the file's. points: of the vertices, cvs:
    // of_vertices(points, 3).
    Deviation deviation(std::span<const double> points, std::span<const double> cvs) const;

  private:
    struct At {
        uint64_t cv; // over all curves
        uint32_t cubic, pattern, step;
    };
    uint32_t pattern_of(size_t curve, uint32_t cubic) const;
    template <typename Visit>
    void for_cvs(size_t curve, Visit&& visit) const;
    template <typename Add>
    void for_vertex(size_t curve, uint32_t cubic, uint32_t i, Add&& add) const;
    std::array<Vec3d, 4> cubic_of(size_t curve, uint32_t cubic, std::span<const double> points) const;
    Deviation deviation_of(size_t curve, std::span<const double> points, std::span<const double> cvs) const;

    UsdaCurveKind kind_;
    bool keeps_vertices_;
    // Where the CVs of a cubic are, ascending from 0 to 1 inclusive: without a corner, with one at its begin,
    // at its end, at both.
    std::array<std::vector<double>, 4> patterns_;
    std::vector<char> corners_; // [joint]; empty: none
    std::vector<uint32_t> counts_;
    std::vector<uint64_t> vertices_, joints_, cvs_; // index of each curve's first, and the total
};

} // namespace marram
