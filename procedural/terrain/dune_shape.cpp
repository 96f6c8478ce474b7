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
// A segment, in coordinates along it with P above t = 0: V0 at t0, V1 at t1 = t0 + l, side s, A = s^2 + eps^2, R = sqrt(A + t^2),
// c = t / R, p = R0 R1 + t0 t1 (>= A by the Cauchy-Schwarz inequality). With c1 - c0 = A l (R0 + R1) / (R0 R1 (p + A)),
//     I  = [t (3A + 2t^2) / (3 A^2 R^3)]  = [c - c^3/3] / A^2
//        = l (R0 + R1) / (3 R0 R1 (p + A)) (1/R0^2 + 1/R1^2 + (R0^2 + t1^2) / (R0 R1 p))       integral of w
//     J  = [-1 / (3 R^3)]                                                                       of t w
//     K  = [c^3 / (3A)]  = l (R0 + R1) / (R0 R1 (p + A)) (c1^2 + c1 c0 + c0^2) / 3              of t^2 w
//     M  = [-1/R] - A J                                                                         of t^3 w
// The right-hand forms avoid the cancellation of [...], which loses (D / eps)^4 roundings far beyond an end.
// Between the ends p loses (l / eps)^2 of them: 10^-10 at l = 1000 eps.
//
// Softening eps: 1/1000 of the spacing, at least 10^-5 of the longest segment. It removes the singularity on
// the curve. There, averages weight the curve by w, with a mean |t| of eps / 2. So a kink that changes the
// slope of H by k lowers the crest by k eps / 4, which is 0.05 % of a peak that is one spacing wide on either
// side. At ends (half a line) the mean |t| is eps / 2 too.
//
// Averages (step 8). f_bar = integral of f w / integral of w for H, the widths and the pinch. The sides
// follow from the mean sigma = sum of s_i I_i / (D sum of I_i): +-1 beside a straight line, 0 straight beyond
// an end. The outer share is b = smoothstep(1/2 + sigma). It changes within 0.6 eps of the crest, where both
// slopes have their ramp's first value, and beyond an end over the wedge of 45 degrees on either side of the
// axis. The positive side with flip = false is the left one as seen from above, y up, x to the right and z
// down the page: (uz, -ux) for the direction (ux, uz).
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
// Bound of the support. With w(t) a width along the curve, w_bar^4 <= mean of w^4 (power means), so
//     F = 3/4 integral of w(t)^4 (|P - C(t)|^2 + eps^2)^(-5/2) dt <= 1     gives     w_bar <= D.
// With ((w + r)^2 + eps^2)^2 in place of w^4 it gives (w_bar + r)^2 <= d^2, which is beyond the foot:
// sqrt(w^2 + 2 w r) <= w + r. w is the greatest of the outer and inner width, max_dist and eps; with a
// stretched plane, that plane uses the outer width alone and the plain one omits it. Over a stretch of a row
// the sum is bounded by discs about the segments (radius half their length), so each width counts only near
// its segment. Samples with F <= 1 are not evaluated. Outside the curve F has no local maximum, by the
// maximum principle (its Laplacian is at least 0 for distances above 0.63 eps). So a line beyond the curve on
// which F <= 1 bounds the dune: the box is four such lines, found by bisection. F ignores sides: it uses the
// outer width on the inner side too, so the box of a barchan is 1.5 to 2 times larger than needed.
//
// Far field. A run of 8 segments is replaced by one point with its length and attribute integrals if its
// centre is at a distance r >= 10 reach and >= 10 of its radii rho. Its part of the sum is at most 3/4 l D^4
// / r^5. Its own error is at most 15 (rho / (r - rho))^2 of that in I (the first moment about the centre is
// 0) and 5 rho / (r - rho) of the change of an attribute in the run. Summed over both directions of a curve,
// at D = reach, where the height is 0: below 1e-5 of I and 2e-5 of an attribute's change in a run. Both fall
// as D^4. The worst case is a curve that fills the plane with branches 2 reach apart: 1e-5 by the mean second
// moment of a run. The far field is blended in over the next 10 % of r, which avoids a step.
//
// Cost: a square root and a division a segment for 8 points, 0.6 ns a sample and segment on a long curve, 5
// where a dune has only 16 segments, with AVX2 on one thread. Building a barchan: 30 us, most of it for the
// box.
#include "procedural/terrain/dune_shape.h"

#include "core/math/digest.h"
#include "core/math/hash.h"

#include <algorithm>
#include <cassert>
#include <limits>

namespace marram {
namespace {

constexpr double dune_max_coordinate = 1e9; // coordinates, metres
constexpr double dune_max_value = 1e6;      // of ramps and lengths
constexpr int dune_max_segments = 4096, dune_max_breaks = 512, dune_run = 8;
constexpr double dune_corner = 0.93969262078590838; // cos(20 degrees)

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

// Valid points that differ by more than the rounding of their coordinates, relative to the centre of their
// box.
DuneLine dune_cleaned_polyline(std::span<const Vec2d> points, bool closed, Vec2d& origin) {
    DuneLine line;
    Vec2d low(infinity, infinity), high(-infinity, -infinity);
    for (const Vec2d& p : points) {
        if (!(p.cwiseAbs().maxCoeff() <= dune_max_coordinate) || !p.allFinite()) continue;
        low = low.cwiseMin(p), high = high.cwiseMax(p);
        line.at.push_back(p);
    }
    if (line.at.empty()) return line;
    origin = 0.5 * (low + high);
    const double rounding = 1e-12 * (origin.cwiseAbs().maxCoeff() + (high - low).maxCoeff());
    size_t kept = 0;
    for (const Vec2d& p : line.at) {
        const Vec2d here = p - origin;
        if (kept == 0 || (here - line.at[kept - 1]).norm() > rounding) line.at[kept++] = here;
    }
    line.at.resize(kept);
    if (closed)
        while (line.at.size() > 1 && (line.at.back() - line.at.front()).norm() <= rounding)
            line.at.pop_back();
    line.closed = closed && line.at.size() > 2;
    if (line.closed) line.at.push_back(line.at.front());
    line.measure();
    return line;
}

DuneLine dune_resampled_evenly(const DuneLine& line, int count) {
    DuneLine out;
    out.closed = line.closed;
    for (int i = 0; i < count; ++i) out.at.push_back(line.point(line.length() * i / count));
    out.at.push_back(line.at.back());
    out.measure();
    return out;
}

// Keeps all points and inserts more, at most `spacing` apart.
DuneLine dune_subdivided(const DuneLine& line, double spacing) {
    DuneLine out;
    out.closed = line.closed;
    for (size_t i = 1; i < line.at.size(); ++i) {
        const int n = std::max(1, int(std::ceil((line.arc[i] - line.arc[i - 1]) / spacing)));
        for (int k = 0; k < n; ++k)
            out.at.push_back(line.at[i - 1] + (double(k) / n) * (line.at[i] - line.at[i - 1]));
    }
    out.at.push_back(line.at.back());
    out.measure();
    return out;
}

Vec2d dune_direction(const Vec2d& from, const Vec2d& to, const Vec2d& otherwise) {
    const double length = (to - from).norm();
    return length > 0.0 ? Vec2d((to - from) / length) : otherwise;
}

void dune_push(DuneLine& line, const Ramp& push, double outer_sign) {
    const size_t n = line.at.size() - 1;
    std::vector<Vec2d> moved(line.at);
    Vec2d last(1.0, 0.0);
    for (size_t i = 0; i <= n; ++i) {
        const size_t before = i > 0 ? i - 1 : line.closed ? n - 1 : 0;
        const size_t after = i < n ? i + 1 : line.closed ? 1 : n;
        const Vec2d in = dune_direction(line.at[before], line.at[i], Vec2d::Zero());
        const Vec2d out = dune_direction(line.at[i], line.at[after], Vec2d::Zero());
        last = dune_direction(Vec2d::Zero(), in + out, last); // a reversal has no normal: keep the last one
        const double u = line.closed && i == n ? 0.0 : line.arc[i] / line.length();
        moved[i] -= outer_sign * push(u) * Vec2d(last.y(), -last.x());
    }
    line.at = std::move(moved);
    if (line.closed) line.at.back() = line.at.front();
    line.measure();
}

// Point k of an evenly sampled line, extended beyond its ends.
Vec2d dune_extended(const DuneLine& line, int k) {
    const int n = int(line.at.size()) - 1;
    if (line.closed) return line.at[size_t(((k % n) + n) % n)];
    const int turns = int(std::floor(double(k) / (2.0 * n)));
    k -= 2 * n * turns;
    const Vec2d first = line.at.front(), last = line.at.back();
    const Vec2d shift = 2.0 * turns * (last - first);
    return k <= n ? Vec2d(line.at[size_t(k)] + shift)
                  : Vec2d(2.0 * last - line.at[size_t(2 * n - k)] + shift);
}

void dune_smooth(DuneLine& line, double deviation) { // deviation in steps of the line
    const int n = int(line.at.size()) - 1, half = int(std::ceil(4.0 * deviation));
    std::vector<double> weights;
    double sum = 0.0;
    for (int k = -half; k <= half; ++k) {
        weights.push_back(std::exp(-0.5 * (k / deviation) * (k / deviation)));
        sum += weights.back();
    }
    std::vector<Vec2d> extended, smooth(line.at);
    for (int k = -half; k <= n + half; ++k) extended.push_back(dune_extended(line, k));
    for (int i = 0; i <= n; ++i) {
        Vec2d mean = Vec2d::Zero(); // of the offsets from the point, so that ends stay bit-identical
        for (int k = 0; k <= 2 * half; ++k)
            mean += weights[size_t(k)] * (extended[size_t(i + k)] - line.at[size_t(i)]);
        smooth[size_t(i)] += mean / sum;
    }
    if (line.closed) smooth.back() = smooth.front();
    if (!line.closed) smooth.front() = line.at.front(), smooth.back() = line.at.back();
    line.at = std::move(smooth);
    line.measure();
}

// Pushes and smooths the curve: step 1 without its last resampling.
DuneLine dune_pushed_and_smoothed(DuneLine line, const DuneSettings& s, double spacing, double outer_sign) {
    const auto pushes = s.crest_push.values();
    const bool push = std::any_of(pushes.begin(), pushes.end(), [](double v) { return v != 0.0; });
    double deviation = s.smoothing * s.slope_width;
    if (line.closed) deviation = std::min(deviation, line.length() / 16.0);
    if (!(deviation > 0.0)) {
        if (!push) return line;
        line = dune_subdivided(line, std::max(spacing / 4.0, line.length() / 16384.0));
        dune_push(line, s.crest_push, outer_sign);
        return line;
    }
    // Fine enough for the Gaussian and for the result, but not finer than the Gaussian resolves.
    const double step =
        std::max({std::min(spacing / 4.0, deviation / 2.0), deviation / 16.0, line.length() / 32768.0});
    const int count = std::max(32, int(std::ceil(line.length() / step)));
    line = dune_resampled_evenly(line, count);
    if (push) {
        dune_push(line, s.crest_push, outer_sign);
        if (!(line.length() > 0.0)) return line;
        line = dune_resampled_evenly(line, count);
    }
    dune_smooth(line, std::min(deviation / (line.length() / count), 64.0));
    return line;
}

void dune_add_knots(std::vector<double>& breaks, const Ramp& ramp) {
    for (const double p : ramp.positions())
        if (p > 0.0 && p < 1.0) breaks.push_back(p);
}

// Length fractions of the fixed points of the resampled curve: ends, knots, corners.
std::vector<double> dune_fixed_points(const DuneLine& line, const DuneSettings& s, double spacing) {
    std::vector<double> knots, corners;
    for (const Ramp* ramp : {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve,
                             &s.inner_slope_fall_off_along_curve, &s.crest_pinch})
        dune_add_knots(knots, *ramp);
    for (size_t i = 1; i + 1 < line.at.size(); ++i) {
        const Vec2d in = dune_direction(line.at[i - 1], line.at[i], Vec2d(1.0, 0.0));
        const Vec2d out = dune_direction(line.at[i], line.at[i + 1], in);
        if (in.dot(out) < dune_corner) corners.push_back(line.arc[i] / line.length());
    }
    if (knots.size() > size_t(dune_max_breaks)) knots.clear();
    if (corners.size() > size_t(dune_max_breaks)) corners.clear();
    std::vector<double> all(std::move(knots)), kept = {0.0};
    all.insert(all.end(), corners.begin(), corners.end());
    std::sort(all.begin(), all.end());
    const double nearest =
        std::min(1e-4 * spacing / line.length(), 1e-2); // moves a peak no more than eps does
    for (const double u : all)
        if (u - kept.back() > nearest && 1.0 - u > nearest) kept.push_back(u);
    kept.push_back(1.0);
    return kept;
}

// Length fractions of all points of the resampled curve.
std::vector<double> dune_stations(const DuneLine& line, const DuneSettings& s, double spacing) {
    const std::vector<double> breaks = dune_fixed_points(line, s, spacing);
    const double fewest = line.closed ? 8.0 : 2.0;
    const double share =
        std::clamp(spacing / line.length(), 1.0 / (dune_max_segments - 2 * dune_max_breaks), 1.0 / fewest);
    std::vector<double> stations;
    for (size_t i = 1; i < breaks.size(); ++i) {
        const double step = breaks[i] - breaks[i - 1];
        const int n = std::max(1, int(std::ceil(step / share - 1e-6))); // 1e-6: ignore rounding
        for (int k = 0; k < n; ++k) stations.push_back(breaks[i - 1] + step * k / n);
    }
    stations.push_back(1.0);
    return stations;
}

// Smooth noise in [-1, 1]. Period `cells`; 0: not periodic.
double dune_noise(double position, int64_t cells, uint64_t key) {
    const double cell = std::floor(position), t = position - cell;
    const auto value = [&](int64_t i) {
        if (cells > 0) i = ((i % cells) + cells) % cells;
        return 2.0 * unit_double(hash(key, uint64_t(i))) - 1.0;
    };
    const double a = value(int64_t(cell)), b = value(int64_t(cell) + 1);
    return a + t * t * (3.0 - 2.0 * t) * (b - a);
}

// Height, widths and pinch at a fraction of the length.
struct DuneCurveProfile {
    const DuneSettings& s;
    double length, spacing;
    bool closed;

    double height(double u) const {
        return std::clamp(s.max_height * s.main_curve_shape(u), 0.0, dune_max_value);
    }
    double width(double u, uint64_t side, const Ramp& fall_off, double mult) const {
        const double period = std::max(s.boundary_noise_length, 2.0 * spacing);
        const int64_t cells = closed ? std::max<int64_t>(2, std::llround(length / period)) : 0;
        const double position = closed ? u * double(cells) : u * length / period;
        const double noise = s.boundary_noise * dune_noise(position, cells, hash(s.seed, side));
        return std::clamp((s.slope_width + noise) * fall_off(u) * mult, 0.0, dune_max_value);
    }
    DuneCrestPoint at(const Vec2d& place, double along) const {
        const double u = closed && along >= 1.0 ? 0.0 : along;
        return {place,
                along,
                height(u),
                width(u, 1, s.outer_slope_fall_off_along_curve, s.outer_slope_mult),
                width(u, 2, s.inner_slope_fall_off_along_curve, s.inner_slope_mult),
                std::clamp(s.crest_pinch(u), 0.0, 1e3)};
    }
};

// Coefficients c of the cubic through f(0), f(1/3), f(2/3), f(1), in powers of t in [0, 1].
void dune_cubic(const double f[4], double c[4]) {
    c[0] = f[0];
    c[1] = -5.5 * f[0] + 9.0 * f[1] - 4.5 * f[2] + f[3];
    c[2] = 9.0 * f[0] - 22.5 * f[1] + 18.0 * f[2] - 4.5 * f[3];
    c[3] = -4.5 * f[0] + 13.5 * f[1] - 13.5 * f[2] + 4.5 * f[3];
}

// Coefficients of the height over metres along a segment. Raises `most` to an upper bound of the height.
void dune_heights_along(const DuneCurveProfile& rules, const DuneCrestPoint& a, const DuneCrestPoint& b,
                        bool curved, double length, double out[4], double& most) {
    double c[4] = {a.height, b.height - a.height, 0.0, 0.0};
    if (curved) {
        const double third = (b.along - a.along) / 3.0;
        const double f[4] = {a.height, rules.height(a.along + third), rules.height(b.along - third),
                             b.height};
        dune_cubic(f, c);
    }
    // The Bezier control points bound the cubic.
    most = std::max({most, c[0], c[0] + c[1] / 3.0, c[0] + 2.0 / 3.0 * c[1] + c[2] / 3.0, b.height});
    double power = 1.0;
    for (int k = 0; k < 4; ++k, power *= length) out[k] = c[k] / power;
}

void dune_build_segments(const DuneCurveProfile& rules, const std::vector<DuneCrestPoint>& points,
                         DuneField& field, double& highest) {
    const bool smooth = rules.s.main_curve_shape.interpolation() == Ramp::Interpolation::smooth;
    const bool seam = rules.closed && rules.height(0.0) != rules.height(1.0);
    const auto in_plane = [&](const Vec2d& p) {
        return Vec2d(field.xx * p.x() + field.xz * p.y(), field.xz * p.x() + field.zz * p.y());
    };
    for (size_t i = 0; i + 1 < points.size(); ++i) {
        const DuneCrestPoint &a = points[i], &b = points[i + 1];
        const Vec2d from = in_plane(a.at), step = in_plane(b.at) - from;
        DuneSegment out{};
        out.x = from.x(), out.z = from.y(), out.along = a.along;
        out.length = step.norm();
        out.ux = step.x() / out.length, out.uz = step.y() / out.length;
        const bool curved = smooth && !(seam && i + 2 == points.size());
        dune_heights_along(rules, a, b, curved, out.length, out.height, highest);
        out.outer[0] = a.outer_width, out.outer[1] = (b.outer_width - a.outer_width) / out.length;
        out.inner[0] = a.inner_width, out.inner[1] = (b.inner_width - a.inner_width) / out.length;
        out.pinch[0] = a.pinch, out.pinch[1] = (b.pinch - a.pinch) / out.length;
        field.segments.push_back(out);
    }
    const DuneCrestPoint& end = points.back();
    const Vec2d at = in_plane(end.at);
    DuneSegment last{};
    last.x = at.x(), last.z = at.y(), last.along = end.along;
    last.height[0] = end.height, last.outer[0] = end.outer_width, last.inner[0] = end.inner_width;
    last.pinch[0] = end.pinch;
    field.segments.push_back(last);
}

double dune_integral(const double c[2], double l) { return l * (c[0] + 0.5 * l * c[1]); }

DuneChunk dune_chunk(const DuneField& field, double outer_sign, int first, int last) {
    DuneChunk c{};
    c.first = first, c.last = last;
    for (int i = first; i < last; ++i) {
        const DuneSegment& s = field.segments[size_t(i)];
        const double l = s.length;
        c.length += l;
        c.x += l * (s.x + 0.5 * l * s.ux), c.z += l * (s.z + 0.5 * l * s.uz);
        c.height +=
            l * (s.height[0] + l * (s.height[1] / 2.0 + l * (s.height[2] / 3.0 + l * s.height[3] / 4.0)));
        c.outer += dune_integral(s.outer, l), c.inner += dune_integral(s.inner, l);
        c.pinch += dune_integral(s.pinch, l);
        const double nx = outer_sign * s.uz, nz = -outer_sign * s.ux;
        c.side_x += l * nx, c.side_z += l * nz, c.side_0 += l * (nx * s.x + nz * s.z);
    }
    c.x /= c.length, c.z /= c.length;
    for (int i = first; i <= last; ++i) {
        const DuneSegment& s = field.segments[size_t(i)];
        c.radius = std::max(c.radius, std::hypot(s.x - c.x, s.z - c.z));
    }
    const double begin = 10.0 * std::max(field.reach, c.radius);
    c.far_begin = begin * begin;
    c.far_blend = 1.0 / (0.21 * c.far_begin); // to 1.1 times the distance
    return c;
}

// The widths that a field must bound: see "Bound of the support" in the file head.
struct DuneBoundedWidths {
    bool outer, inner;
    double max_dist, crest_radius, cotangent;
};

// Upper bound of the integral of ((w + crest_radius)^2 + eps^2)^2 along a segment, w the greatest of the
// bounded widths. The integrand is convex in w, and w is a maximum of linear functions, so the mean is at
// most that of the two ends.
double dune_cover_weight(const DuneSegment& s, const DuneBoundedWidths& what, double softening2) {
    const double l = s.length, least = std::max(std::sqrt(softening2), what.max_dist);
    double begin = least, end = least;
    if (what.outer) begin = std::max(begin, s.outer[0]), end = std::max(end, s.outer[0] + l * s.outer[1]);
    if (what.inner && what.cotangent > 0.0) {
        const double* c = s.height; // the greatest Bezier control point bounds the cubic
        const double linear = l * c[1], square = l * l * c[2], cube = l * l * l * c[3];
        const double most = std::max(
            {c[0], c[0] + linear / 3.0, c[0] + (2.0 * linear + square) / 3.0, c[0] + linear + square + cube});
        const bool straight = c[2] == 0.0 && c[3] == 0.0;
        begin = std::max(begin, what.cotangent * (straight ? c[0] : most));
        end = std::max(end, what.cotangent * (straight ? c[0] + linear : most));
    } else if (what.inner)
        begin = std::max(begin, s.inner[0]), end = std::max(end, s.inner[0] + l * s.inner[1]);
    const auto power = [&](double w) {
        const double square = (w + what.crest_radius) * (w + what.crest_radius) + softening2;
        return square * square;
    };
    return 0.5 * l * (power(begin) + power(end));
}

void dune_build_chunks(DuneField& field, double outer_sign, const DuneBoundedWidths& what) {
    const int count = int(field.segments.size()) - 1;
    for (int i = 0; i < count; i += dune_run) {
        DuneChunk chunk = dune_chunk(field, outer_sign, i, std::min(i + dune_run, count));
        DuneCover cover{};
        for (int k = 0; k < lanes; ++k) {
            const bool there = i + k < chunk.last;
            const DuneSegment& s = field.segments[size_t(there ? i + k : chunk.last - 1)];
            cover.x[k] = s.x + 0.5 * s.length * s.ux, cover.z[k] = s.z + 0.5 * s.length * s.uz;
            cover.half[k] = 0.5 * s.length;
            cover.weight[k] = there ? dune_cover_weight(s, what, field.softening2) : 0.0;
            chunk.cover += cover.weight[k];
        }
        field.chunks.push_back(chunk);
        field.covers.push_back(cover);
    }
}

static_assert(dune_run == lanes);

struct DuneBound {
    // Upper bound of 4/3 F (file head) on the line from (x0, z0) to (x1, z1). Stops early once it exceeds
    // `enough`.
    MARRAM_HOT static double sum(const DuneField& field, double x0, double z0, double x1, double z1,
                                 double enough);
};

MARRAM_HOT double DuneBound::sum(const DuneField& field, double x0, double z0, double x1, double z1,
                                 double enough) {
    const double ax = field.xx * x0 + field.xz * z0, az = field.xz * x0 + field.zz * z0;
    const double wx = field.xx * (x1 - x0) + field.xz * (z1 - z0),
                 wz = field.xz * (x1 - x0) + field.zz * (z1 - z0);
    const double way2 = wx * wx + wz * wz, inverse = way2 > 0.0 ? 1.0 / way2 : 0.0;
    double total = 0.0;
    for (size_t k = 0; k < field.chunks.size() && total <= enough; ++k) {
        const DuneChunk& c = field.chunks[k];
        const double t = std::min(std::max(((c.x - ax) * wx + (c.z - az) * wz) * inverse, 0.0), 1.0);
        const double dx = c.x - ax - t * wx, dz = c.z - az - t * wz, r2 = dx * dx + dz * dz;
        constexpr double far = 8.0; // radii: one disc for the whole run overestimates by less than (8/7)^5
        if (r2 > far * far * c.radius * c.radius) {
            const double r = std::sqrt(r2) - c.radius, s2 = r * r + field.softening2;
            total += c.cover / (s2 * s2 * std::sqrt(s2));
            continue;
        }
        const VDouble x = vload(field.covers[k].x), z = vload(field.covers[k].z);
        const VDouble half = vload(field.covers[k].half), weight = vload(field.covers[k].weight);
        const VDouble u = vmin(vmax(((x - ax) * wx + (z - az) * wz) * inverse, VDouble{}), 1.0);
        const VDouble ex = x - ax - u * wx, ez = z - az - u * wz;
        const VDouble r = vmax(vsqrt(ex * ex + ez * ez) - half, VDouble{}), s2 = r * r + field.softening2;
        const VDouble share = weight / (s2 * s2 * vsqrt(s2));
        for (int i = 0; i < lanes; ++i) total += share[i];
    }
    return total;
}

// The dune is 0 where the sum is at most this. 1e-9 covers the rounding of the sum.
constexpr double dune_zero_limit = (1.0 - 1e-9) * 4.0 / 3.0;

bool dune_is_zero(const DuneParts& parts, double x0, double z0, double x1, double z1) {
    return DuneBound::sum(parts.plain, x0, z0, x1, z1, dune_zero_limit) <= dune_zero_limit &&
           (parts.stretched.chunks.empty() ||
            DuneBound::sum(parts.stretched, x0, z0, x1, z1, dune_zero_limit) <= dune_zero_limit);
}

// The dune is 0 beyond this distance from the curve. A stretched distance is at least the plain one.
double dune_max_distance(const DuneField& field) {
    double total = 0.0;
    for (const DuneChunk& c : field.chunks) total += c.cover;
    return std::pow(total / dune_zero_limit, 0.2) * (1.0 + 1e-9);
}

// How far the dune extends beyond the curve's box on one side. Bisects for a line on which the dune is 0; the
// sum is no greater beyond it (see the file head).
double dune_margin(const DuneParts& parts, const double box[2][2], double farthest, int axis, int side) {
    const int other = 1 - axis;
    const double from = box[0][other] - farthest, extent = box[1][other] + farthest - from;
    const int stretches = int(std::clamp(std::ceil(4.0 * extent / farthest), 8.0, 32.0));
    double low = 0.0, high = farthest;
    for (int step = 0; step < 7; ++step) {
        const double middle = 0.5 * (low + high);
        double a[2], b[2];
        a[axis] = b[axis] = side ? box[1][axis] + middle : box[0][axis] - middle;
        bool clear = true;
        for (int i = 0; i < stretches && clear; ++i) {
            a[other] = from + extent * i / stretches, b[other] = from + extent * (i + 1) / stretches;
            clear = dune_is_zero(parts, a[0], a[1], b[0], b[1]);
        }
        (clear ? high : low) = middle;
    }
    return high;
}

void dune_box(const DuneParts& parts, Vec2d& lower, Vec2d& upper) {
    double box[2][2] = {{infinity, infinity}, {-infinity, -infinity}};
    for (const DuneSegment& s : parts.plain.segments) {
        box[0][0] = std::min(box[0][0], s.x), box[1][0] = std::max(box[1][0], s.x);
        box[0][1] = std::min(box[0][1], s.z), box[1][1] = std::max(box[1][1], s.z);
    }
    double farthest = dune_max_distance(parts.plain);
    if (!parts.stretched.chunks.empty()) farthest = std::max(farthest, dune_max_distance(parts.stretched));
    for (int axis = 0; axis < 2; ++axis) {
        lower[axis] = box[0][axis] - dune_margin(parts, box, farthest, axis, 0);
        upper[axis] = box[1][axis] + dune_margin(parts, box, farthest, axis, 1);
    }
}

// --- Evaluation, eight points at once ---

struct DuneSums {
    VDouble weight{}, height{}, outer{}, inner{}, pinch{}, side{}, x{}, z{};
};

struct DuneLanes {
    VDouble height, mask, outer, inner, dist, x, z;
};

// Sums the closed forms of the file head over a run of segments. Neighbours share an end: one square root a
// segment.
template <bool cubic, bool directed>
MARRAM_INLINE void dune_near(const DuneSegment* s, const DuneSegment* end, double softening2, double sign,
                             VDouble px, VDouble pz, DuneSums& sums) {
    VDouble dx = px - s->x, dz = pz - s->z;
    VDouble r0 = dx * dx + dz * dz + softening2, root0 = vsqrt(r0), inverse0 = 1.0 / root0;
    VDouble cube0 = inverse0 * inverse0 * inverse0;
    for (; s != end; ++s) {
        const double nx = sign * s->uz, nz = -sign * s->ux, l = s->length;
        const VDouble t0 = -(dx * s->ux + dz * s->uz), t1 = t0 + l;
        const VDouble side = dx * nx + dz * nz, a = side * side + softening2;
        dx = px - s[1].x, dz = pz - s[1].z;
        const VDouble r1 = dx * dx + dz * dz + softening2, root1 = vsqrt(r1);
        const VDouble p = vmax(root0 * root1 + t0 * t1, a), pp = p * (p + a);
        const VDouble share = 1.0 / (root1 * pp); // one division for both inverses
        const VDouble inverse1 = share * pp, both = inverse0 * inverse1;
        const VDouble cube1 = inverse1 * inverse1 * inverse1;
        const VDouble scaled = l * (root0 + root1) * both * (share * root1);
        const VDouble squares = inverse0 * inverse0 + inverse1 * inverse1;
        const VDouble i = scaled * (squares * p + (r0 + t1 * t1) * both) * (1.0 / 3.0);
        const VDouble j = (cube0 - cube1) * (1.0 / 3.0);
        const VDouble first = j - t0 * i; // moments about the segment's start
        sums.weight += i;
        sums.height += s->height[0] * i + s->height[1] * first;
        if (cubic) {
            const VDouble c0 = t0 * inverse0, c1 = t1 * inverse1;
            const VDouble k = scaled * p * (c1 * c1 + c1 * c0 + c0 * c0) * (1.0 / 3.0);
            const VDouble m = (inverse0 - inverse1) - a * j;
            sums.height += s->height[2] * (k - t0 * (j + first)) +
                           s->height[3] * (m - t0 * (3.0 * k - t0 * (2.0 * j + first)));
        }
        sums.outer += s->outer[0] * i + s->outer[1] * first;
        sums.inner += s->inner[0] * i + s->inner[1] * first;
        sums.pinch += s->pinch[0] * i + s->pinch[1] * first;
        const VDouble turned = side * i;
        sums.side += turned;
        if (directed) sums.x += s->ux * j - nx * turned, sums.z += s->uz * j - nz * turned;
        r0 = r1, root0 = root1, inverse0 = inverse1, cube0 = cube1;
    }
}

// Adds the run as one point with weight `far`, and `near` with weight 1 - far.
MARRAM_INLINE void dune_blend(const DuneChunk& c, VDouble far, VDouble dx, VDouble dz, VDouble r2, VDouble px,
                              VDouble pz, const DuneSums& near, DuneSums& sums) {
    const VDouble rest = 1.0 - far, w = far / (r2 * r2 * vsqrt(r2));
    sums.weight += near.weight * rest + c.length * w;
    sums.height += near.height * rest + c.height * w;
    sums.outer += near.outer * rest + c.outer * w;
    sums.inner += near.inner * rest + c.inner * w;
    sums.pinch += near.pinch * rest + c.pinch * w;
    sums.side += near.side * rest + (c.side_x * px + c.side_z * pz - c.side_0) * w;
    sums.x += near.x * rest - c.length * dx * w;
    sums.z += near.z * rest - c.length * dz * w;
}

MARRAM_INLINE void dune_add(const DuneSums& near, DuneSums& sums) {
    sums.weight += near.weight, sums.height += near.height, sums.outer += near.outer;
    sums.inner += near.inner, sums.pinch += near.pinch, sums.side += near.side;
    sums.x += near.x, sums.z += near.z;
}

template <bool cubic, bool directed>
MARRAM_INLINE DuneSums dune_sums(const DuneField& field, double sign, VDouble x, VDouble z) {
    DuneSums sums;
    const VDouble px = field.xx * x + field.xz * z, pz = field.xz * x + field.zz * z;
    const DuneSegment* segments = field.segments.data();
    const DuneChunk *chunk = field.chunks.data(), *end = chunk + field.chunks.size();
    for (; chunk != end; ++chunk) {
        const DuneChunk& c = *chunk;
        const VDouble dx = px - c.x, dz = pz - c.z, r2 = dx * dx + dz * dz;
        const VDouble above = (r2 - c.far_begin) * c.far_blend;
        DuneSums near;
        if (any(above < 1.0))
            dune_near<cubic, directed>(segments + c.first, segments + c.last, field.softening2, sign, px, pz,
                                       near);
        if (any(above > 0.0)) {
            const VDouble t = vmin(vmax(above, VDouble{}), 1.0);
            dune_blend(c, t * t * (3.0 - 2.0 * t), dx, dz, r2 + field.softening2, px, pz, near, sums);
        } else
            dune_add(near, sums);
    }
    return sums;
}

MARRAM_INLINE VDouble dune_ramp(const DuneRamp& ramp, VDouble x) {
    VDouble y = splat(ramp.values[0]);
    for (size_t k = 0; k < ramp.values.size(); ++k) {
        VDouble t = (x - ramp.positions[k]) * ramp.inverses[k];
        if (ramp.smooth) t = t * t * (3.0 - 2.0 * t);
        y = select(x >= ramp.positions[k], ramp.values[k] + t * ramp.steps[k], y);
    }
    return y;
}

// Relative height of a slope at the fraction `x` of its width; 0 beyond the foot.
MARRAM_INLINE VDouble dune_slope(const DuneRamp& ramp, VDouble x, VDouble pinch) {
    VDouble pinched = x;
    if (any(pinch > 0.0)) {
        constexpr double least = 1e-300; // the logarithm's domain; below it x is 0
        const VDouble power = vexp(vlog(vmin(vmax(x, least), 1.0)) / (1.0 + pinch));
        pinched = select(pinch > 0.0, select(x > least, power, 0.0), x);
    }
    const VDouble y = dune_ramp(ramp, pinched);
    return select(x < 1.0, y, 0.0);
}

// Weighted means of a field at eight points.
struct DuneMeans {
    VDouble D, d, share, height, outer, inner, pinch; // share: of the outer side
};

MARRAM_INLINE DuneMeans dune_means(const DuneParts& parts, double softening2, const DuneSums& sums) {
    const VDouble zero{}, one = splat(1.0), inverse = 1.0 / sums.weight;
    DuneMeans m;
    const VDouble D2 = 1.0 / vsqrt(0.75 * sums.weight);
    m.D = vsqrt(D2);
    m.d = vsqrt(vmax(D2 - softening2, zero));
    const VDouble t = vmin(vmax(0.5 + sums.side * inverse / m.D, zero), one);
    m.share = t * t * (3.0 - 2.0 * t);
    m.height = vmax(sums.height * inverse, zero), m.pinch = vmax(sums.pinch * inverse, zero);
    m.outer = sums.outer * inverse;
    m.inner = parts.cotangent > 0.0 ? m.height * parts.cotangent : sums.inner * inverse;
    return m;
}

// Distance from the rounded crest, in slope widths.
MARRAM_INLINE VDouble dune_slope_coordinate(const DuneParts& parts, VDouble d, VDouble width,
                                            VDouble softening) {
    const double r = parts.settings.crest_radius;
    if (r > 0.0) d = d * d / (vsqrt(d * d + r * r) + r);
    return d / vmax(width, softening);
}

// Computes everything except the direction from the means of the outer slope (o) and of the inner slope (i).
MARRAM_INLINE void dune_combine_slopes(const DuneParts& parts, const DuneMeans& o, const DuneMeans& i,
                                       double outer_softening, double inner_softening, DuneLanes& out) {
    const DuneSettings& s = parts.settings;
    const VDouble zero{}, one = splat(1.0), b = o.share;
    const VDouble soft_o = splat(std::sqrt(outer_softening)), soft_i = splat(std::sqrt(inner_softening));
    const VDouble xo = dune_slope_coordinate(parts, o.d, o.outer, soft_o),
                  xi = dune_slope_coordinate(parts, i.d, i.inner, soft_i);
    const VDouble there = vmin(vmax(o.outer, o.inner) / soft_o, one);
    const VDouble so = dune_slope(parts.outer_slope, xo, o.pinch);
    const VDouble si =
        parts.cotangent > 0.0 ? vmax(1.0 - xi, zero) : dune_slope(parts.inner_slope, xi, i.pinch);
    out.height = there * (b * (o.height * so) + (1.0 - b) * (i.height * si));
    const VDouble xm = s.max_dist > 0.0 ? i.d / s.max_dist : b * vmin(xo, one) + (1.0 - b) * vmin(xi, one);
    const VDouble mask = dune_ramp(parts.mask, xm);
    out.mask = select(xm < 1.0, vmin(vmax(mask, zero), one), zero);
    out.outer = select(xo < 1.0, b, zero);
    out.inner = select(xi < 1.0, 1.0 - b, zero);
    const VLong in = (xo < 1.0) | (xi < 1.0) | (xm < 1.0);
    out.dist = select(in, vmin(i.d, parts.reach), parts.reach);
}

MARRAM_INLINE void dune_sample_direction(const DuneParts& parts, const DuneSums& sums, VDouble D,
                                         DuneLanes& out) {
    const VDouble norm = vsqrt(sums.x * sums.x + sums.z * sums.z);
    const VLong in = (norm > 1e-9 * D * sums.weight) & (out.dist < parts.reach);
    out.x = select(in, sums.x / norm, 0.0);
    out.z = select(in, sums.z / norm, 0.0);
}

// With a stretched plane, the plain distance is computed only where the inner slope, mask or direction needs
// it.
template <bool cubic, bool directed>
MARRAM_INLINE void dune_evaluate(const DuneParts& parts, VDouble x, VDouble z, DuneLanes& out) {
    const DuneField &plain = parts.plain, &stretched = parts.stretched;
    if (stretched.chunks.empty()) {
        const DuneSums sums = dune_sums<cubic, directed>(plain, parts.outer_sign, x, z);
        const DuneMeans means = dune_means(parts, plain.softening2, sums);
        dune_combine_slopes(parts, means, means, plain.softening2, plain.softening2, out);
        if (directed) dune_sample_direction(parts, sums, means.D, out);
        return;
    }
    const DuneMeans outer =
        dune_means(parts, stretched.softening2, dune_sums<cubic, false>(stretched, parts.outer_sign, x, z));
    DuneMeans inner = outer;
    if (directed || parts.settings.max_dist > 0.0 || any(outer.share < 1.0)) {
        const DuneSums sums = dune_sums<cubic, directed>(plain, parts.outer_sign, x, z);
        inner = dune_means(parts, plain.softening2, sums);
        dune_combine_slopes(parts, outer, inner, stretched.softening2, plain.softening2, out);
        if (directed) dune_sample_direction(parts, sums, inner.D, out);
        return;
    }
    dune_combine_slopes(parts, outer, inner, stretched.softening2, plain.softening2, out);
}

struct DuneEval {
    // Points must be inside the dune's box; coordinates are relative to its origin.
    MARRAM_HOT static void heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                   DuneLanes& out);
    MARRAM_HOT static void all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out);
};

MARRAM_HOT void DuneEval::heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                  DuneLanes& out) {
    if (parts.cubic)
        dune_evaluate<true, false>(parts, x, z, out);
    else
        dune_evaluate<false, false>(parts, x, z, out);
}

MARRAM_HOT void DuneEval::all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out) {
    if (parts.cubic)
        dune_evaluate<true, true>(parts, x, z, out);
    else
        dune_evaluate<false, true>(parts, x, z, out);
}

DuneSample dune_lane(const DuneLanes& out, int i) {
    return {out.height[i], out.mask[i], out.outer[i], out.inner[i], out.dist[i], Vec2d(out.x[i], out.z[i])};
}

// Sets the matrix that stretches the plane across the dune's axis. Returns false if the plane is not
// stretched.
bool dune_stretch(const std::vector<DuneCrestPoint>& crest, const DuneSettings& s, double length,
                  DuneField& field) {
    const Vec2d chord = crest.back().at - crest.front().at;
    const double k = s.outer_slope_stretch - 1.0, span = chord.norm();
    if (!(k > 0.0) || !(span > 1e-6 * length)) return false; // coincident ends define no axis
    const double c = std::cos(s.outer_slope_turn), t = std::sin(s.outer_slope_turn);
    const Vec2d across = Vec2d(c * chord.x() - t * chord.y(), t * chord.x() + c * chord.y()) / span;
    field.xx = 1.0 + k * across.x() * across.x();
    field.zz = 1.0 + k * across.y() * across.y();
    field.xz = k * across.x() * across.y();
    return true;
}

void dune_build_field(const DuneCurveProfile& rules, const std::vector<DuneCrestPoint>& crest,
                      double outer_sign, const DuneBoundedWidths& what, DuneField& field) {
    double highest = 0.0, widest = 0.0, longest = 0.0;
    dune_build_segments(rules, crest, field, highest);
    for (const DuneSegment& s : field.segments) {
        longest = std::max(longest, s.length);
        if (what.outer) widest = std::max(widest, s.outer[0]);
        if (what.inner && !(what.cotangent > 0.0)) widest = std::max(widest, s.inner[0]);
    }
    if (what.inner) widest = std::max(widest, highest * what.cotangent);
    const double softening = std::max(1e-3 * rules.spacing, 1e-5 * longest);
    field.softening2 = softening * softening;
    field.reach = std::max({widest + what.crest_radius, what.max_dist, softening}) * (1.0 + 1e-9);
    dune_build_chunks(field, outer_sign, what);
}

DuneRamp dune_knots(const Ramp& ramp) {
    DuneRamp out;
    out.smooth = ramp.interpolation() == Ramp::Interpolation::smooth;
    const bool constant = ramp.interpolation() == Ramp::Interpolation::constant;
    const size_t count = ramp.values().size();
    for (size_t k = 0; k < count; ++k) {
        const bool last = k + 1 == count;
        const double apart = last ? 0.0 : ramp.positions()[k + 1] - ramp.positions()[k];
        const bool between = apart > 0.0 && !constant;
        out.positions.push_back(ramp.positions()[k]);
        out.values.push_back(ramp.values()[k]);
        out.steps.push_back(between ? ramp.values()[k + 1] - ramp.values()[k] : 0.0);
        out.inverses.push_back(between ? std::min(1.0 / apart, 1e300) : 0.0);
    }
    return out;
}

void dune_build(const DuneCurveProfile& rules, const std::vector<DuneCrestPoint>& crest, DuneParts& parts) {
    const DuneSettings& s = rules.s;
    if (s.inner_slope_angle > 0.0) parts.cotangent = 1.0 / std::tan(s.inner_slope_angle);
    parts.outer_slope = dune_knots(s.outer_slope_shape);
    parts.inner_slope = dune_knots(s.inner_slope_shape);
    parts.mask = dune_knots(s.mask_fall_off);
    const bool stretched = dune_stretch(crest, s, rules.length, parts.stretched);
    DuneBoundedWidths what{!stretched, true, s.max_dist, s.crest_radius, parts.cotangent};
    dune_build_field(rules, crest, parts.outer_sign, what, parts.plain);
    if (stretched) {
        what = {true, false, 0.0, s.crest_radius, parts.cotangent};
        dune_build_field(rules, crest, parts.outer_sign, what, parts.stretched);
    }
    parts.reach = std::max(parts.plain.reach, parts.stretched.reach);
    for (const DuneSegment& segment : parts.plain.segments)
        parts.cubic = parts.cubic || segment.height[2] != 0.0 || segment.height[3] != 0.0;
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

DuneSample DuneShape::outside() const {
    DuneSample sample;
    sample.dist = parts_.reach;
    return sample;
}

DuneSample DuneShape::sample(const Vec2d& at) const {
    if (empty() ||
        !(at.x() >= lower_.x() && at.x() <= upper_.x() && at.y() >= lower_.y() && at.y() <= upper_.y()))
        return outside();
    DuneLanes out;
    DuneEval::all(parts_, splat(at.x() - parts_.origin.x()), splat(at.y() - parts_.origin.y()), out);
    return dune_lane(out, 0);
}

// Whether the dune is 0 on all of row z between x0 and x1.
bool DuneShape::misses(double x0, double x1, double z) const {
    if (!(std::max(x0, x1) >= lower_.x() && std::min(x0, x1) <= upper_.x() && z >= lower_.y() &&
          z <= upper_.y()))
        return true;
    const double row = z - parts_.origin.y();
    return dune_is_zero(parts_, x0 - parts_.origin.x(), row, x1 - parts_.origin.x(), row);
}

namespace {

// Calls miss(begin, end) or hit(begin, end) for each stretch of a row. Tests 64 samples first, then 8.
template <typename Misses, typename Miss, typename Hit>
void dune_row(int count, const Misses& misses, const Miss& miss, const Hit& hit) {
    constexpr int tile = 64;
    for (int i = 0; i < count; i += tile) {
        const int end = std::min(i + tile, count);
        if (misses(i, end)) {
            miss(i, end);
            continue;
        }
        for (int k = i; k < end; k += lanes) {
            const int stop = std::min(k + lanes, end);
            if (misses(k, stop))
                miss(k, stop);
            else
                hit(k, stop);
        }
    }
}

} // namespace

void DuneShape::row(double x, double z, double cell, int count, double* height, double* mask) const {
    DuneLanes out;
    dune_row(
        count, [&](int i, int end) { return empty() || misses(x + i * cell, x + (end - 1) * cell, z); },
        [&](int i, int end) {
            std::fill(height + i, height + end, 0.0);
            std::fill(mask + i, mask + end, 0.0);
        },
        [&](int i, int end) {
            VDouble px;
            // Clamp to the box: the dune is 0 on its edge and beyond.
            for (int k = 0; k < lanes; ++k)
                px[k] = std::clamp(x + std::min(i + k, end - 1) * cell, lower_.x(), upper_.x()) -
                        parts_.origin.x();
            DuneEval::heights(parts_, px, splat(z - parts_.origin.y()), out);
            for (int k = i; k < end; ++k) height[k] = out.height[k - i], mask[k] = out.mask[k - i];
        });
}

void DuneShape::row(double x, double z, double cell, int count, DuneSample* samples) const {
    DuneLanes out;
    dune_row(
        count, [&](int i, int end) { return empty() || misses(x + i * cell, x + (end - 1) * cell, z); },
        [&](int i, int end) { std::fill(samples + i, samples + end, outside()); },
        [&](int i, int end) {
            VDouble px;
            for (int k = 0; k < lanes; ++k)
                px[k] = std::clamp(x + std::min(i + k, end - 1) * cell, lower_.x(), upper_.x()) -
                        parts_.origin.x();
            DuneEval::all(parts_, px, splat(z - parts_.origin.y()), out);
            for (int k = i; k < end; ++k) samples[k] = dune_lane(out, k - i);
        });
}

} // namespace marram
