// SPDX-License-Identifier: Apache-2.0
// Curves of USD as Marram draws them: pinned B-splines and pinned Catmull-Rom curves as they are, linear ones through their points, all
// others as Catmull-Rom curves through the joints of their cubics, or of pieces of these. Periodic ones are opened: they end where they
// begin.
#pragma once

#include "core/geometry/usda_curves.h"
#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

class UsdaCvs {
  public:
    UsdaCvs(UsdaCurveKind kind, std::vector<uint32_t> counts);

    MarramBasis basis() const;
    bool as_they_are() const { return as_they_are_; } // the CVs are the vertices
    void cut(uint32_t pieces);                        // of each cubic; 1 at first. Only where !as_they_are()

    size_t curve_count() const { return counts_.size(); }
    size_t vertex_count() const { return vertices_.back(); }
    size_t joint_count() const { return joints_.back(); } // how many values "varying" has
    size_t cv_count() const { return cvs_.back(); }
    std::vector<uint32_t> cv_counts() const;

    // Values of vertices or of joints at the CVs, `components` each. Discrete ones are those of the vertex that weighs most, or of the
    // nearest joint. Cost: 10 ns a CV and processor.
    std::vector<double> of_vertices(std::span<const double> values, size_t components, bool discrete) const;
    std::vector<double> of_joints(std::span<const double> values, size_t components, bool discrete) const;
    std::vector<double> of_curves(std::span<const double> values, size_t components) const;

    struct Deviation {
        double distance = 0.0, share = 0.0; // the greatest; share: of a curve's length
    };
    // How far the drawn curve is from the file's. points: of the vertices, cvs: of_vertices(points, 3).
    Deviation deviation(std::span<const double> points, std::span<const double> cvs) const;

  private:
    uint64_t vertex_of(size_t curve, uint32_t cubic, uint32_t i) const; // in all
    Deviation deviation_of(size_t curve, std::span<const double> points, std::span<const double> cvs) const;

    UsdaCurveKind kind_;
    bool as_they_are_;
    uint32_t pieces_ = 1;
    std::vector<uint32_t> counts_;
    std::vector<uint64_t> vertices_, joints_, cvs_; // of each curve's first, and behind the last
};

} // namespace marram
