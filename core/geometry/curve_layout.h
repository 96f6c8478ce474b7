// SPDX-License-Identifier: Apache-2.0
// Indices of each curve's CVs, vertices and segments. A curve of n CVs has n + 2 vertices and n - 1 segments
// (core/plugin/marram_plugin.h, MarramCurves).
#pragma once

#include <cstdint>

namespace marram {

struct CurveLayout {
    uint64_t curve_count = 0;
    uint32_t cvs_per_curve = 0;        // if all curves have as many
    const uint64_t* offsets = nullptr; // else: [curve_count + 1], index of each first CV

    uint64_t first_cv(uint64_t curve) const { return offsets ? offsets[curve] : curve * cvs_per_curve; }
    uint32_t cvs(uint64_t curve) const {
        return offsets ? uint32_t(offsets[curve + 1] - offsets[curve]) : cvs_per_curve;
    }
    uint64_t first_vertex(uint64_t curve) const { return first_cv(curve) + 2 * curve; }
    uint64_t first_segment(uint64_t curve) const { return first_cv(curve) - curve; }
    uint64_t cv_count() const { return first_cv(curve_count); }
    uint64_t vertex_count() const { return first_vertex(curve_count); }
    uint64_t segment_count() const { return first_segment(curve_count); }
};

} // namespace marram
