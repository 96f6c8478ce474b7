// SPDX-License-Identifier: Apache-2.0
// Converts USD curves to CVs: pinned B-splines and pinned Catmull-Rom curves are kept, linear ones connect
// their points, all others become Catmull-Rom curves through the joints of their cubics, or of pieces of
// these. Periodic curves are opened: they end where they begin.
#pragma once

#include "core/geometry/usda_curves.h"
#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

class UsdaCvs {
  public:
    UsdaCvs(UsdaCurveKind kind, std::vector<uint32_t> counts);

    MarramBasis basis() const;
    bool keeps_vertices() const { return keeps_vertices_; } // the CVs are the vertices
    void cut(uint32_t pieces); // pieces per cubic; 1 at first. Only if !keeps_vertices()

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
    uint64_t vertex_of(size_t curve, uint32_t cubic, uint32_t i) const; // index over all curves
    Deviation deviation_of(size_t curve, std::span<const double> points, std::span<const double> cvs) const;

    UsdaCurveKind kind_;
    bool keeps_vertices_;
    uint32_t pieces_ = 1;
    std::vector<uint32_t> counts_;
    std::vector<uint64_t> vertices_, joints_, cvs_; // index of each curve's first, and the total
};

} // namespace marram
