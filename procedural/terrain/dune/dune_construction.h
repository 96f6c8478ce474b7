// SPDX-License-Identifier: Apache-2.0
// Shared by the files of DuneShape only: the steps from a drawn curve to the data for evaluation. Lengths in
// metres, coordinates relative to DuneParts::origin.
#pragma once

#include "procedural/terrain/dune/dune_shape.h"

#include <algorithm>
#include <span>
#include <vector>

namespace marram {

struct DuneCurveProfile;

// A polyline with the arc length at its points. A closed one ends with its first point.
struct DuneLine {
    std::vector<Vec2d> at;
    std::vector<double> arc;
    bool closed = false;

    double length() const { return arc.empty() ? 0.0 : arc.back(); }
    void measure() {
        arc.assign(at.size(), 0.0);
        for (size_t i = 1; i < at.size(); ++i) arc[i] = arc[i - 1] + (at[i] - at[i - 1]).norm();
    }
    Vec2d point(double s) const {
        const auto above = std::upper_bound(arc.begin() + 1, arc.end() - 1, s);
        const auto i = size_t(above - arc.begin());
        const double step = arc[i] - arc[i - 1];
        const double t = step > 0.0 ? std::clamp((s - arc[i - 1]) / step, 0.0, 1.0) : 0.0;
        return at[i - 1] + t * (at[i] - at[i - 1]);
    }
};

// --- dune_curve.cpp: step 1 ---

// Valid points that differ by more than the rounding of their coordinates, relative to the centre of their
// box.
DuneLine dune_cleaned_polyline(std::span<const Vec2d> points, bool closed, Vec2d& origin);
// Pushes and smooths the curve: step 1 without its last resampling.
DuneLine dune_pushed_and_smoothed(DuneLine line, const DuneSettings& s, double spacing, double outer_sign);
// Length fractions of all points of the resampled curve.
std::vector<double> dune_stations(const DuneLine& line, const DuneSettings& s, double spacing);

// --- dune_parts.cpp ---

// Fills `parts` except origin, settings and outer_sign; reads outer_sign. `crest`: two or more points, no two
// neighbours the same.
void dune_build(const DuneCurveProfile& rules, const std::vector<DuneCrestPoint>& crest, DuneParts& parts);

// --- dune_bound.cpp ---

// The widths that a field must bound: see "Bound of the support" in dune_bound.cpp.
struct DuneBoundedWidths {
    bool outer, inner;
    double max_dist, crest_radius, cotangent;
};
// Upper bound of the integral of ((w + crest_radius)^2 + eps^2)^2 along a segment, w the greatest of the
// bounded widths. The integrand is convex in w, and w is a maximum of linear functions, so the mean is at
// most that of the two ends.
double dune_cover_weight(const DuneSegment& s, const DuneBoundedWidths& what, double softening2);
// A box outside which the dune is 0. Takes most of the time of building a dune.
void dune_box(const DuneParts& parts, Vec2d& lower, Vec2d& upper);

} // namespace marram
