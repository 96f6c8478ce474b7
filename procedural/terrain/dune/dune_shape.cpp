// SPDX-License-Identifier: Apache-2.0
// One dune along a drawn curve: steps 1 to 8 of the Detailed Desert Toolkit, with every step made continuous.
//
// Curve (step 1). Non-finite and repeated points are dropped. The polyline is resampled finely, its points
// are moved to the inner side by crest_push(u), and it is smoothed by a Gaussian over arc length: standard
// deviation smoothing * slope_width, cut at 4 of them. Open curves are extended beyond their ends by point
// reflection, so the ends stay; closed ones are periodic and the deviation is at most 1/16 of their length.
// Then the curve is resampled at equal arc length: spacing slope_width / search_accuracy, 2 (closed: 8) to
// 4096 segments. Corners of more than 20 degrees and the knots of the ramps along the curve, up to 512 of
// each, are also points of the result; the stretches between them are divided evenly. So smoothing = 0 keeps
// a drawn corner.
//
// Along it (steps 2 to 4). u is the fraction of the arc length, 0 to 1. Crest height H = max_height *
// main_curve_shape(u), at least 0. Widths w = max((slope_width + noise(u)) * fall_off(u) * mult, 0) of either
// side. The noise is value noise with the weight t t (3 - 2 t) between hashed values in [-boundary_noise,
// boundary_noise]; its lattice is boundary_noise_length wide, at least two spacings, and periodic on a closed
// curve. With a smooth ramp, H is the cubic through four points of a segment (such a ramp is a cubic between
// two knots); everything else is linear along a segment. A step in a ramp extends over one segment, also at
// the seam of a closed curve, whose end has the values of its beginning.
//
// Distance (in place of steps 5 to 7). With r^2 = |P - C(t)|^2 + eps^2 and w = r^-5, t the arc length,
//     D = (3/4 integral of w dt)^(-1/4),    d = sqrt(max(D^2 - eps^2, 0)).
// Along an infinite straight line the integral is 4 / (3 (s^2 + eps^2)^2), so d is exactly the distance s.
// Elsewhere it is a power mean of distances: smooth beyond ends, at corners, between near branches and at
// self-intersections. (The single-layer relative of the L_p distance fields of Belyaev, Fayolle, Pasko,
// "Signed L_p-distance fields", Computer-Aided Design 45, 2013; the kernel and its closed forms on segments:
// Hubert, Cani, "Convolution surfaces based on polygonal curve skeletons", J. Symbolic Computation 47, 2012.)
// Straight beyond an end D = (16/3)^(1/4) = 1.52 distances; half way between two parallel branches 2^(-1/4) =
// 0.84. On the curve D = eps up to (eps / radius)^2. The gradient of d is 1 on a straight stretch, up to 1.52
// beyond ends.
//
// Softening eps: 1/1000 of the spacing, at least 10^-5 of the longest segment. It removes the singularity on
// the curve. There, averages weight the curve by w, with a mean |t| of eps / 2. So a kink that changes the
// slope of H by k lowers the crest by k eps / 4, which is 0.05 % of a peak that is one spacing wide on either
// side. At ends (half a line) the mean |t| is eps / 2 too.
//
// Averages (step 8). f_bar = integral of f w / integral of w for H, the widths and the pinch. The sides
// follow from the mean sigma = sum of s_i I_i / (D sum of I_i), over segments i with signed distances s_i of
// P from their lines and integrals I_i of w: +-1 beside a straight line, 0 straight beyond an end. The outer
// share is b = smoothstep(1/2 + sigma). It changes within 0.6 eps of the crest, where both slopes have their
// ramp's first value, and beyond an end over the wedge of 45 degrees on either side of the axis. The positive
// side with flip = false is the left one as seen from above, y up, x to the right and z down the page:
// (uz, -ux) for the direction (ux, uz).
//
//     height = b H_bar S_o(x_o) + (1 - b) H_bar S_i(x_i),   x = (d / w_bar)^(1/(1 + q)),   S = 0 where x >= 1
// with the pinch q >= 0. With inner_slope_angle > 0, w_i = H_bar / tan(angle), S_i = 1 - x, without pinch and
// noise: the slope has that angle on a straight stretch, and is steeper by the gradient of d elsewhere.
// Widths below eps count as eps. If both widths are below eps, the height falls linearly to 0 with the
// greater, so a dune without width has no height.
//
// Crest radius r: the slopes use d' = sqrt(d^2 + r^2) - r in place of d, computed as d^2 / (sqrt(d^2 + r^2) +
// r). This rounds the crest over about r and keeps its height. Slopes are multiplied by d / sqrt(d^2 + r^2)
// (0.71 at r, 0.97 at 4 r). The foot, where d' = w, moves out to sqrt(w^2 + 2 w r), by less than r. A radius
// of one cell hides the stair steps of a sharp crest on the grid.
//
// Stretched outer slope: outer_slope_stretch = k > 1. The outer slope takes D, b, H_bar, w_o and q from the
// ground plane transformed by the matrix M = 1 + (k - 1) b b^T, b the unit vector across the dune's axis.
// Distances along the axis stay and those across it are multiplied by k, so the slope reaches k times further
// along the axis. The inner slope, `dist`, max_dist and sample_dir use the plain distance. On the crest both
// planes have d = 0 and the same H, so the slopes meet; the crest radius of the outer slope is r / k across
// the axis. In M's plane a crest that is an arc across the axis has k^2 times less curvature, and D is nearer
// to the distance along the axis. The axis is perpendicular to the line between the ends, turned by
// outer_slope_turn. If the ends are closer than 10^-6 of the length, as on a closed curve, k is taken as 1.
//
// Mask (step 5): mask_fall_off(x_m), clamped to [0, 1], and 0 where x_m >= 1. x_m = d / max_dist, also if
// that is beyond the foot; for max_dist = 0 it is b min(x_o, 1) + (1 - b) min(x_i, 1), without pinch.
// sample_dir is the normalized integral of (C - P) w, which is smooth by itself (step 7). It is 0 outside the
// dune and its mask, and where the integral is below 10^-9 D: on the crest it is rounding.
//
// Ranges: lengths to 10^6 m, coordinates to 10^9 m, slope_width from 1 mm, search_accuracy 1 to 64,
// outer_slope_stretch 1 to 16, factors to 1000, angle 0.1 to 89 degrees, values of ramps to 10^6. All sums
// are finite there.
//
// Cost: a square root and a division a segment for 8 points, 0.6 ns a sample and segment on a long curve, 5
// where a dune has only 16 segments, with AVX2 on one thread. Building a barchan: 30 us, most of it for the
// box.
//
// Files: dune_curve.cpp makes the curve, dune_profile.h gives height and widths along it, dune_parts.cpp
// builds the data for evaluation, dune_bound.cpp finds where the dune is 0, dune_evaluation.cpp evaluates it.
// This file: the ranges, the digest and the order of these steps.
#include "procedural/terrain/dune/dune_shape.h"

#include "core/math/digest.h"
#include "procedural/terrain/dune/dune_construction.h"
#include "procedural/terrain/dune/dune_profile.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

double dune_clamped(double x, double low, double high) {
    return std::isfinite(x) ? std::clamp(x, low, high) : low;
}

Ramp dune_clamped(const Ramp& ramp) {
    std::vector<double> knots;
    for (size_t i = 0; i < ramp.values().size(); ++i) {
        knots.push_back(dune_clamped(ramp.positions()[i], -dune_max_value, dune_max_value));
        knots.push_back(dune_clamped(ramp.values()[i], -dune_max_value, dune_max_value));
    }
    const auto how = ramp.interpolation();
    return Ramp(knots, how == Ramp::Interpolation::constant ? "constant"
                       : how == Ramp::Interpolation::smooth ? "smooth"
                                                            : "linear");
}

DuneSettings dune_clamped(DuneSettings s) {
    constexpr double most = dune_max_value;
    s.max_height = dune_clamped(s.max_height, 0.0, most);
    s.slope_width = dune_clamped(s.slope_width, 1e-3, most);
    s.outer_slope_mult = dune_clamped(s.outer_slope_mult, 0.0, 1e3);
    s.inner_slope_mult = dune_clamped(s.inner_slope_mult, 0.0, 1e3);
    if (s.inner_slope_angle > 0.0)
        s.inner_slope_angle = dune_clamped(s.inner_slope_angle, 0.1 * degree, 89.0 * degree);
    s.outer_slope_stretch = dune_clamped(s.outer_slope_stretch, 1.0, 16.0);
    s.outer_slope_turn = dune_clamped(s.outer_slope_turn, -pi, pi);
    s.crest_radius = dune_clamped(s.crest_radius, 0.0, most);
    s.boundary_noise = dune_clamped(s.boundary_noise, 0.0, most);
    s.boundary_noise_length = dune_clamped(s.boundary_noise_length, 1e-3, most);
    s.max_dist = dune_clamped(s.max_dist, 0.0, most);
    s.smoothing = dune_clamped(s.smoothing, 0.0, 1e3);
    s.search_accuracy = dune_clamped(s.search_accuracy, 1.0, 64.0);
    for (Ramp* ramp :
         {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve, &s.inner_slope_fall_off_along_curve,
          &s.outer_slope_shape, &s.inner_slope_shape, &s.mask_fall_off, &s.crest_push, &s.crest_pinch})
        *ramp = dune_clamped(*ramp);
    return s;
}

void dune_digest(Digest& digest, const Ramp& ramp) {
    digest.add(ramp.positions().data(), ramp.positions().size_bytes());
    digest.add(ramp.values().data(), ramp.values().size_bytes());
    digest.add(uint64_t(ramp.interpolation()));
}

uint64_t dune_digest(std::span<const Vec2d> points, bool closed, const DuneSettings& s) {
    Digest digest;
    digest.add("dune 2").add(points.data(), points.size_bytes());
    const double numbers[] = {
        s.max_height,        s.slope_width,     s.outer_slope_mult,      s.inner_slope_mult,
        s.inner_slope_angle, s.boundary_noise,  s.boundary_noise_length, s.max_dist,
        s.smoothing,         s.search_accuracy, s.outer_slope_stretch,   s.crest_radius,
        s.outer_slope_turn};
    digest.add(numbers, sizeof numbers);
    digest.add(s.seed).add(uint64_t(s.flip)).add(uint64_t(closed));
    for (const Ramp* ramp :
         {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve, &s.inner_slope_fall_off_along_curve,
          &s.outer_slope_shape, &s.inner_slope_shape, &s.mask_fall_off, &s.crest_push, &s.crest_pinch})
        dune_digest(digest, *ramp);
    return digest.value();
}

} // namespace

DuneShape::DuneShape(std::span<const Vec2d> points, bool closed, const DuneSettings& settings)
    : digest_(dune_digest(points, closed, settings)) {
    parts_.settings = dune_clamped(settings);
    const DuneSettings& s = parts_.settings;
    parts_.outer_sign = s.flip ? -1.0 : 1.0;
    DuneLine line = dune_cleaned_polyline(points, closed, parts_.origin);
    const double drawn = line.length();
    if (!(drawn > 0.0)) return;
    const double spacing = s.slope_width / s.search_accuracy;
    line = dune_pushed_and_smoothed(std::move(line), s, spacing, parts_.outer_sign);
    if (!(line.length() > 1e-12 * drawn)) return; // crest_push collapsed the curve to a point
    const std::vector<double> stations = dune_stations(line, s, spacing);
    const DuneCurveProfile rules{s, line.length(), spacing, line.closed};
    std::vector<DuneCrestPoint> crest;
    for (const double u : stations) {
        const Vec2d at = u >= 1.0 && line.closed ? line.at.front() : line.point(u * line.length());
        // A curve that turns back on itself has coincident points.
        if (crest.empty() || (at - crest.back().at).norm() > 1e-12 * drawn) crest.push_back(rules.at(at, u));
    }
    if (crest.size() < 2) return;
    dune_build(rules, crest, parts_);
    Vec2d lower, upper;
    dune_box(parts_, lower, upper);
    lower_ = lower + parts_.origin, upper_ = upper + parts_.origin;
}

std::vector<Vec2d> DuneShape::crest() const {
    std::vector<Vec2d> points;
    for (const DuneSegment& s : parts_.plain.segments) points.push_back(Vec2d(s.x, s.z) + parts_.origin);
    return points;
}

std::vector<DuneCrestPoint> DuneShape::crest_points() const {
    std::vector<DuneCrestPoint> points;
    for (const DuneSegment& s : parts_.plain.segments)
        points.push_back({Vec2d(s.x, s.z) + parts_.origin, s.along, s.height[0], s.outer[0],
                          parts_.cotangent > 0.0 ? s.height[0] * parts_.cotangent : s.inner[0], s.pinch[0]});
    return points;
}

} // namespace marram
