// SPDX-License-Identifier: Apache-2.0
// One dune along a drawn curve: steps 1 to 8 of the Detailed Desert Toolkit, with every step made continuous.
//
// Curve (step 1). Points that are not finite or repeated are dropped. The polyline is resampled finely, its points are moved to
// the inner side by crest_push(u), it is smoothed by a Gaussian over its arc length (standard deviation smoothing * slope_width,
// cut at 4 of them; an open curve goes on beyond its ends by point reflection, so that its ends stay; a closed one is periodic
// and its deviation is at most 1/16 of its length), and resampled at equal arc length: spacing slope_width / search_accuracy,
// 2 (closed: 8) to 4096 segments. Corners of more than 20 degrees and the knots of the ramps along the curve, up to 512 of each,
// are points of the result too; the stretches between them are divided evenly. So smoothing = 0 keeps a drawn corner.
//
// Along it (steps 2 to 4). u is the share of the arc length, 0 to 1. Crest height H = max_height * main_curve_shape(u), not below 0.
// Widths w = max((slope_width + noise(u)) * fall_off(u) * mult, 0) of either side. The noise is value noise with the weight
// t t (3 - 2 t) between hashed values in [-boundary_noise, boundary_noise]; its lattice is boundary_noise_length wide, at least
// two spacings, and periodic on a closed curve. H is the cubic through four points of a segment where its ramp is smooth (which
// is what that ramp is between two knots), all else is linear along a segment. A ramp that steps does so over one segment, also
// at the seam of a closed curve, whose end has the values of its beginning.
//
// Distance (in place of steps 5 to 7). With r^2 = |P - C(t)|^2 + eps^2 and w = r^-5, t the arc length,
//     D = (3/4 integral of w dt)^(-1/4),    d = sqrt(max(D^2 - eps^2, 0)).
// Along a straight line without ends the integral is 4 / (3 (s^2 + eps^2)^2), so d is exactly the distance s. Everywhere else it
// is a power mean of distances: smooth beyond ends, at corners, between near branches and where the curve crosses itself. (The
// single-layer relative of the L_p distance fields of Belyaev, Fayolle, Pasko, "Signed L_p-distance fields", Computer-Aided Design
// 45, 2013; the kernel and its closed forms on segments: Hubert, Cani, "Convolution surfaces based on polygonal curve skeletons",
// J. Symbolic Computation 47, 2012.) Straight beyond an end D = (16/3)^(1/4) = 1.52 distances; half way between two parallel branches
// 2^(-1/4) = 0.84. On the curve D = eps up to (eps / radius)^2. The gradient of d is 1 on a straight stretch, up to 1.52 beyond ends.
//
// A segment, in coordinates along it with P above t = 0: V0 at t0, V1 at t1 = t0 + l, side s, A = s^2 + eps^2, R = sqrt(A + t^2),
// c = t / R, p = R0 R1 + t0 t1 (>= A by the Cauchy-Schwarz inequality). With c1 - c0 = A l (R0 + R1) / (R0 R1 (p + A)),
//     I  = [t (3A + 2t^2) / (3 A^2 R^3)]  = [c - c^3/3] / A^2
//        = l (R0 + R1) / (3 R0 R1 (p + A)) (1/R0^2 + 1/R1^2 + (R0^2 + t1^2) / (R0 R1 p))       integral of w
//     J  = [-1 / (3 R^3)]                                                                       of t w
//     K  = [c^3 / (3A)]  = l (R0 + R1) / (R0 R1 (p + A)) (c1^2 + c1 c0 + c0^2) / 3              of t^2 w
//     M  = [-1/R] - A J                                                                         of t^3 w
// The right-hand forms hold no difference of nearly equal numbers far beyond an end, where [...] loses (D / eps)^4 roundings.
// Between the ends p loses (l / eps)^2 of them: 10^-10 at l = 1000 eps.
//
// Softening eps: 1/1000 of the spacing, at least 10^-5 of the longest segment. It takes away the singularity on the curve. There
// an average sees the curve with the weights w, of mean |t| = eps / 2: a kink that turns the slope of H by k lowers the crest by
// k eps / 4, which is 0.05 % of a peak that is one spacing wide on either side. Ends (half a line) see |t| = eps / 2.
//
// Averages (step 8). f_bar = integral of f w / integral of w for H, the widths, the pinch. Inner share from the mean of the sides,
// sigma = sum of s_i I_i / (D sum of I_i): +-1 beside a straight line, 0 straight beyond an end. b = smoothstep(1/2 + sigma) is the
// outer share; it turns within 0.6 eps of the crest, where both slopes have their ramp's first value, and beyond an end
// over the wedge of 45 degrees on either side of the axis. Positive sides: with flip = false the left as seen from above, y up, x to
// the right and z down the page: (uz, -ux) of the direction (ux, uz).
//
//     height = H_bar (b S_o(x_o) + (1 - b) S_i(x_i)),   x = (d / w_bar)^(1/(1 + q)),   S = 0 where x >= 1
// with the pinch q >= 0. With inner_slope_angle > 0, w_i = H_bar / tan(angle), S_i = 1 - x, without pinch and noise: the slope is
// that angle on a straight stretch, and steeper by the gradient of d elsewhere. Widths below eps count as eps, and the height
// falls linearly to 0 with the greater of both below eps, so that a dune of no width has no height.
//
// Mask (step 5): mask_fall_off(x_m), within [0, 1]; x_m = d / max_dist, whether the foot is nearer or farther; for max_dist = 0
// b min(x_o, 1) + (1 - b) min(x_i, 1), without pinch. 0 where x_m >= 1. sample_dir: the integral of (C - P) w, made a unit vector:
// smooth by itself (step 7). 0 where there is neither dune nor mask, and where it is below 10^-9 D: on the crest it is rounding.
//
// Ranges: lengths to 10^6 m, coordinates to 10^9 m, slope_width from 1 mm, search_accuracy 1 to 64, factors to 1000, angle 0.1 to 89
// degrees, values of ramps to 10^6. All sums are finite there.
//
// Skipping. I <= length / (distance^2 + eps^2)^(5/2) for a run of segments and its box. Samples whose bound gives D >= reach,
// the greatest width or max_dist, are 0 without being evaluated; the box of the dune is found by the same bound on half planes.
//
// Far field. A run of 8 segments at a distance r from its centre, r >= 10 reach and >= 10 of its radii rho, is taken as one point with
// its length and integrals of attributes. Its share of the sum is at most 3/4 l D^4 / r^5; its own error at most 15 (rho / (r - rho))^2
// of it in I (the first moment is 0 about the centre) and 5 rho / (r - rho) of the change of an attribute in the run. Summed
// over both directions of a curve, at D = reach, where the height is 0: below 1e-5 of I and 2e-5 of an attribute's change in a
// run. Both fall as D^4. A curve that fills the plane with branches 2 reach apart is the worst: 1e-5 by the mean second moment
// of a run. The far field is blended in over the next 10 % of r, so that no step comes of it.
//
// Cost: a square root and a division a segment for 8 points, 2 to 3 ns a sample and segment over the box of a dune of 20 segments with
// AVX-512 on one thread. Building one of 20 segments: 13 us.
#include "procedural/terrain/dune_shape.h"

#include "core/math/digest.h"
#include "core/math/hash.h"

#include <algorithm>
#include <cassert>
#include <limits>

namespace marram {
namespace {

constexpr double dune_far_away = 1e9;   // coordinates, metres
constexpr double dune_most_value = 1e6; // of ramps and lengths
constexpr int dune_most_segments = 4096, dune_most_breaks = 512, dune_run = 8;
constexpr double dune_corner = 0.93969262078590838; // cos(20 degrees)

double dune_within(double x, double low, double high) {
    return std::isfinite(x) ? std::clamp(x, low, high) : low;
}

Ramp dune_within(const Ramp& ramp) {
    std::vector<double> knots;
    for (size_t i = 0; i < ramp.values().size(); ++i) {
        knots.push_back(dune_within(ramp.positions()[i], -dune_most_value, dune_most_value));
        knots.push_back(dune_within(ramp.values()[i], -dune_most_value, dune_most_value));
    }
    const auto how = ramp.interpolation();
    return Ramp(knots, how == Ramp::Interpolation::constant ? "constant"
                       : how == Ramp::Interpolation::smooth ? "smooth"
                                                            : "linear");
}

DuneSettings dune_within(DuneSettings s) {
    constexpr double most = dune_most_value;
    s.max_height = dune_within(s.max_height, 0.0, most);
    s.slope_width = dune_within(s.slope_width, 1e-3, most);
    s.outer_slope_mult = dune_within(s.outer_slope_mult, 0.0, 1e3);
    s.inner_slope_mult = dune_within(s.inner_slope_mult, 0.0, 1e3);
    if (s.inner_slope_angle > 0.0)
        s.inner_slope_angle = dune_within(s.inner_slope_angle, 0.1 * degree, 89.0 * degree);
    s.boundary_noise = dune_within(s.boundary_noise, 0.0, most);
    s.boundary_noise_length = dune_within(s.boundary_noise_length, 1e-3, most);
    s.max_dist = dune_within(s.max_dist, 0.0, most);
    s.smoothing = dune_within(s.smoothing, 0.0, 1e3);
    s.search_accuracy = dune_within(s.search_accuracy, 1.0, 64.0);
    for (Ramp* ramp :
         {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve, &s.inner_slope_fall_off_along_curve,
          &s.outer_slope_shape, &s.inner_slope_shape, &s.mask_fall_off, &s.crest_push, &s.crest_pinch})
        *ramp = dune_within(*ramp);
    return s;
}

void dune_digest(Digest& digest, const Ramp& ramp) {
    digest.add(ramp.positions().data(), ramp.positions().size_bytes());
    digest.add(ramp.values().data(), ramp.values().size_bytes());
    digest.add(uint64_t(ramp.interpolation()));
}

uint64_t dune_digest(std::span<const Vec2d> points, bool closed, const DuneSettings& s) {
    Digest digest;
    digest.add("dune 1").add(points.data(), points.size_bytes());
    const double numbers[] = {
        s.max_height,        s.slope_width,    s.outer_slope_mult,      s.inner_slope_mult,
        s.inner_slope_angle, s.boundary_noise, s.boundary_noise_length, s.max_dist,
        s.smoothing,         s.search_accuracy};
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

// Points that are there and differ by more than the rounding of their coordinates, relative to the middle of their box.
DuneLine dune_drawn(std::span<const Vec2d> points, bool closed, Vec2d& origin) {
    DuneLine line;
    Vec2d low(infinity, infinity), high(-infinity, -infinity);
    for (const Vec2d& p : points) {
        if (!(p.cwiseAbs().maxCoeff() <= dune_far_away) || !p.allFinite()) continue;
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

DuneLine dune_even(const DuneLine& line, int count) {
    DuneLine out;
    out.closed = line.closed;
    for (int i = 0; i < count; ++i) out.at.push_back(line.point(line.length() * i / count));
    out.at.push_back(line.at.back());
    out.measure();
    return out;
}

// All points kept, none further apart than `spacing`.
DuneLine dune_divided(const DuneLine& line, double spacing) {
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
        last = dune_direction(Vec2d::Zero(), in + out, last); // a reversal has no normal of its own
        const double u = line.closed && i == n ? 0.0 : line.arc[i] / line.length();
        moved[i] -= outer_sign * push(u) * Vec2d(last.y(), -last.x());
    }
    line.at = std::move(moved);
    if (line.closed) line.at.back() = line.at.front();
    line.measure();
}

// Point k of an even line, beyond its ends too.
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

void dune_smooth(DuneLine& line, double deviation) { // in steps of the even line
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
        Vec2d mean = Vec2d::Zero(); // of what differs from the point: an end stays to the bit
        for (int k = 0; k <= 2 * half; ++k)
            mean += weights[size_t(k)] * (extended[size_t(i + k)] - line.at[size_t(i)]);
        smooth[size_t(i)] += mean / sum;
    }
    if (line.closed) smooth.back() = smooth.front();
    if (!line.closed) smooth.front() = line.at.front(), smooth.back() = line.at.back();
    line.at = std::move(smooth);
    line.measure();
}

// Pushed and smoothed: step 1 but its last resampling.
DuneLine dune_fine(DuneLine line, const DuneSettings& s, double spacing, double outer_sign) {
    const auto pushes = s.crest_push.values();
    const bool push = std::any_of(pushes.begin(), pushes.end(), [](double v) { return v != 0.0; });
    double deviation = s.smoothing * s.slope_width;
    if (line.closed) deviation = std::min(deviation, line.length() / 16.0);
    if (!(deviation > 0.0)) {
        if (!push) return line;
        line = dune_divided(line, std::max(spacing / 4.0, line.length() / 16384.0));
        dune_push(line, s.crest_push, outer_sign);
        return line;
    }
    // Fine enough for the Gaussian and for the result; no finer than the Gaussian lets one see.
    const double step =
        std::max({std::min(spacing / 4.0, deviation / 2.0), deviation / 16.0, line.length() / 32768.0});
    const int count = std::max(32, int(std::ceil(line.length() / step)));
    line = dune_even(line, count);
    if (push) {
        dune_push(line, s.crest_push, outer_sign);
        if (!(line.length() > 0.0)) return line;
        line = dune_even(line, count);
    }
    dune_smooth(line, std::min(deviation / (line.length() / count), 64.0));
    return line;
}

void dune_add_knots(std::vector<double>& breaks, const Ramp& ramp) {
    for (const double p : ramp.positions())
        if (p > 0.0 && p < 1.0) breaks.push_back(p);
}

// Shares of the length at which the resampled curve has a point in any case: ends, knots, corners.
std::vector<double> dune_breaks(const DuneLine& line, const DuneSettings& s, double spacing) {
    std::vector<double> knots, corners;
    for (const Ramp* ramp : {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve,
                             &s.inner_slope_fall_off_along_curve, &s.crest_pinch})
        dune_add_knots(knots, *ramp);
    for (size_t i = 1; i + 1 < line.at.size(); ++i) {
        const Vec2d in = dune_direction(line.at[i - 1], line.at[i], Vec2d(1.0, 0.0));
        const Vec2d out = dune_direction(line.at[i], line.at[i + 1], in);
        if (in.dot(out) < dune_corner) corners.push_back(line.arc[i] / line.length());
    }
    if (knots.size() > size_t(dune_most_breaks)) knots.clear();
    if (corners.size() > size_t(dune_most_breaks)) corners.clear();
    std::vector<double> all(std::move(knots)), kept = {0.0};
    all.insert(all.end(), corners.begin(), corners.end());
    std::sort(all.begin(), all.end());
    const double nearest =
        std::min(1e-4 * spacing / line.length(), 1e-2); // moves a peak by as little as eps does
    for (const double u : all)
        if (u - kept.back() > nearest && 1.0 - u > nearest) kept.push_back(u);
    kept.push_back(1.0);
    return kept;
}

// Shares of the length of all points of the resampled curve.
std::vector<double> dune_stations(const DuneLine& line, const DuneSettings& s, double spacing) {
    const std::vector<double> breaks = dune_breaks(line, s, spacing);
    const double fewest = line.closed ? 8.0 : 2.0;
    const double share =
        std::clamp(spacing / line.length(), 1.0 / (dune_most_segments - 2 * dune_most_breaks), 1.0 / fewest);
    std::vector<double> stations;
    for (size_t i = 1; i < breaks.size(); ++i) {
        const double step = breaks[i] - breaks[i - 1];
        const int n = std::max(1, int(std::ceil(step / share - 1e-6))); // 1e-6: rounding makes no segment
        for (int k = 0; k < n; ++k) stations.push_back(breaks[i - 1] + step * k / n);
    }
    stations.push_back(1.0);
    return stations;
}

// In [-1, 1], smooth, the same at 0 and `cells` where it is periodic.
double dune_noise(double position, int64_t cells, uint64_t key) {
    const double cell = std::floor(position), t = position - cell;
    const auto value = [&](int64_t i) {
        if (cells > 0) i = ((i % cells) + cells) % cells;
        return 2.0 * unit_double(hash(key, uint64_t(i))) - 1.0;
    };
    const double a = value(int64_t(cell)), b = value(int64_t(cell) + 1);
    return a + t * t * (3.0 - 2.0 * t) * (b - a);
}

// What holds at a share of the length.
struct DuneRules {
    const DuneSettings& s;
    double length, spacing;
    bool closed;

    double height(double u) const {
        return std::clamp(s.max_height * s.main_curve_shape(u), 0.0, dune_most_value);
    }
    double width(double u, uint64_t side, const Ramp& fall_off, double mult) const {
        const double period = std::max(s.boundary_noise_length, 2.0 * spacing);
        const int64_t cells = closed ? std::max<int64_t>(2, std::llround(length / period)) : 0;
        const double position = closed ? u * double(cells) : u * length / period;
        const double noise = s.boundary_noise * dune_noise(position, cells, hash(s.seed, side));
        return std::clamp((s.slope_width + noise) * fall_off(u) * mult, 0.0, dune_most_value);
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

// Powers of t in [0, 1] of the cubic through f(0), f(1/3), f(2/3), f(1).
void dune_cubic(const double f[4], double c[4]) {
    c[0] = f[0];
    c[1] = -5.5 * f[0] + 9.0 * f[1] - 4.5 * f[2] + f[3];
    c[2] = 9.0 * f[0] - 22.5 * f[1] + 18.0 * f[2] - 4.5 * f[3];
    c[3] = -4.5 * f[0] + 13.5 * f[1] - 13.5 * f[2] + 4.5 * f[3];
}

// Coefficients of the height in metres along a segment; its greatest value bounds `most`.
void dune_heights_along(const DuneRules& rules, const DuneCrestPoint& a, const DuneCrestPoint& b, bool curved,
                        double length, double out[4], double& most) {
    double c[4] = {a.height, b.height - a.height, 0.0, 0.0};
    if (curved) {
        const double third = (b.along - a.along) / 3.0;
        const double f[4] = {a.height, rules.height(a.along + third), rules.height(b.along - third),
                             b.height};
        dune_cubic(f, c);
    }
    // The greatest of the control points of the Bezier form.
    most = std::max({most, c[0], c[0] + c[1] / 3.0, c[0] + 2.0 / 3.0 * c[1] + c[2] / 3.0, b.height});
    double power = 1.0;
    for (int k = 0; k < 4; ++k, power *= length) out[k] = c[k] / power;
}

void dune_build_segments(const DuneRules& rules, const std::vector<DuneCrestPoint>& points, DuneParts& parts,
                         double& highest) {
    const bool smooth = rules.s.main_curve_shape.interpolation() == Ramp::Interpolation::smooth;
    const bool seam = rules.closed && rules.height(0.0) != rules.height(1.0);
    for (size_t i = 0; i + 1 < points.size(); ++i) {
        const DuneCrestPoint &a = points[i], &b = points[i + 1];
        DuneSegment out{};
        out.x = a.at.x(), out.z = a.at.y(), out.along = a.along;
        out.length = (b.at - a.at).norm();
        out.ux = (b.at.x() - a.at.x()) / out.length, out.uz = (b.at.y() - a.at.y()) / out.length;
        const bool curved = smooth && !(seam && i + 2 == points.size());
        dune_heights_along(rules, a, b, curved, out.length, out.height, highest);
        parts.cubic = parts.cubic || out.height[2] != 0.0 || out.height[3] != 0.0;
        out.outer[0] = a.outer_width, out.outer[1] = (b.outer_width - a.outer_width) / out.length;
        out.inner[0] = a.inner_width, out.inner[1] = (b.inner_width - a.inner_width) / out.length;
        out.pinch[0] = a.pinch, out.pinch[1] = (b.pinch - a.pinch) / out.length;
        parts.segments.push_back(out);
    }
    const DuneCrestPoint& end = points.back();
    DuneSegment last{};
    last.x = end.at.x(), last.z = end.at.y(), last.along = end.along;
    last.height[0] = end.height, last.outer[0] = end.outer_width, last.inner[0] = end.inner_width;
    last.pinch[0] = end.pinch;
    parts.segments.push_back(last);
}

double dune_integral(const double c[2], double l) { return l * (c[0] + 0.5 * l * c[1]); }

DuneChunk dune_chunk(const DuneParts& parts, int first, int last) {
    DuneChunk c{};
    c.first = first, c.last = last;
    c.lower[0] = c.lower[1] = infinity, c.upper[0] = c.upper[1] = -infinity;
    for (int i = first; i <= last; ++i) {
        const DuneSegment& s = parts.segments[size_t(i)];
        c.lower[0] = std::min(c.lower[0], s.x), c.upper[0] = std::max(c.upper[0], s.x);
        c.lower[1] = std::min(c.lower[1], s.z), c.upper[1] = std::max(c.upper[1], s.z);
        if (i == last) break;
        const double l = s.length;
        c.length += l;
        c.x += l * (s.x + 0.5 * l * s.ux), c.z += l * (s.z + 0.5 * l * s.uz);
        c.height +=
            l * (s.height[0] + l * (s.height[1] / 2.0 + l * (s.height[2] / 3.0 + l * s.height[3] / 4.0)));
        c.outer += dune_integral(s.outer, l), c.inner += dune_integral(s.inner, l);
        c.pinch += dune_integral(s.pinch, l);
        const double nx = parts.outer_sign * s.uz, nz = -parts.outer_sign * s.ux;
        c.side_x += l * nx, c.side_z += l * nz, c.side_0 += l * (nx * s.x + nz * s.z);
    }
    c.x /= c.length, c.z /= c.length;
    double radius = 0.0;
    for (int i = first; i <= last; ++i) {
        const DuneSegment& s = parts.segments[size_t(i)];
        radius = std::max(radius, std::hypot(s.x - c.x, s.z - c.z));
    }
    const double begin = 10.0 * std::max(parts.reach, radius);
    c.far_begin = begin * begin;
    c.far_blend = 1.0 / (0.21 * c.far_begin); // to 1.1 times the distance
    return c;
}

void dune_build_chunks(DuneParts& parts) {
    const int count = int(parts.segments.size()) - 1;
    for (int i = 0; i < count; i += dune_run)
        parts.chunks.push_back(dune_chunk(parts, i, std::min(i + dune_run, count)));
}

// The greatest sum of the weights of all segments at any point of the box.
double dune_bound(const DuneParts& parts, const double lower[2], const double upper[2], double enough) {
    double sum = 0.0;
    for (const DuneChunk& c : parts.chunks) {
        const double x = std::max({c.lower[0] - upper[0], lower[0] - c.upper[0], 0.0});
        const double z = std::max({c.lower[1] - upper[1], lower[1] - c.upper[1], 0.0});
        const double r2 = x * x + z * z + parts.softening2;
        sum += c.length / (r2 * r2 * std::sqrt(r2));
        if (sum > enough) break;
    }
    return sum;
}

// Below this sum of weights the smooth distance is at least reach; 1e-9: all roundings of a sum.
double dune_least_weight(const DuneParts& parts) {
    const double r2 = parts.reach * parts.reach + parts.softening2;
    return (1.0 - 1e-9) * 4.0 / (3.0 * r2 * r2);
}

// How far the dune reaches beyond the curve's box on one side of it: bisection on the bound over stretches of that side.
double dune_margin(const DuneParts& parts, const double box[2][2], int axis, int side) {
    const double least = dune_least_weight(parts);
    double total = 0.0;
    for (const DuneChunk& c : parts.chunks) total += c.length;
    double low = 0.0, high = std::pow(total / least, 0.2) * (1.0 + 1e-9);
    const int other = 1 - axis;
    const double extent = box[1][other] - box[0][other];
    const int stretches = int(std::clamp(std::ceil(2.0 * extent / parts.reach), 1.0, 32.0));
    for (int step = 0; step < 10; ++step) {
        const double middle = 0.5 * (low + high);
        bool clear = true;
        for (int i = 0; i < stretches && clear; ++i) {
            double lower[2], upper[2];
            lower[axis] = upper[axis] = side ? box[1][axis] + middle : box[0][axis] - middle;
            lower[other] = i == 0 ? -infinity : box[0][other] + extent * i / stretches;
            upper[other] = i + 1 == stretches ? infinity : box[0][other] + extent * (i + 1) / stretches;
            clear = dune_bound(parts, lower, upper, least) <= least;
        }
        (clear ? high : low) = middle;
    }
    return high;
}

void dune_box(const DuneParts& parts, Vec2d& lower, Vec2d& upper) {
    double box[2][2] = {{infinity, infinity}, {-infinity, -infinity}};
    for (const DuneChunk& c : parts.chunks)
        for (int axis = 0; axis < 2; ++axis) {
            box[0][axis] = std::min(box[0][axis], c.lower[axis]);
            box[1][axis] = std::max(box[1][axis], c.upper[axis]);
        }
    for (int axis = 0; axis < 2; ++axis) {
        lower[axis] = box[0][axis] - dune_margin(parts, box, axis, 0);
        upper[axis] = box[1][axis] + dune_margin(parts, box, axis, 1);
    }
}

// --- Evaluation, eight points at once ---

struct DuneSums {
    VDouble weight{}, height{}, outer{}, inner{}, pinch{}, side{}, x{}, z{};
};

struct DuneLanes {
    VDouble height, mask, outer, inner, dist, x, z;
};

// The closed forms of the page, summed over a run of segments. The end of one segment is the begin of the next: one root each.
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
        const VDouble first = j - t0 * i; // moments about the begin
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

// sums += the run as one point, weighed by `far`, and `near` by the rest.
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
MARRAM_INLINE DuneSums dune_sums(const DuneParts& parts, const DuneSegment* segments, const DuneChunk* chunk,
                                 const DuneChunk* end, VDouble px, VDouble pz) {
    DuneSums sums;
    for (; chunk != end; ++chunk) {
        const DuneChunk& c = *chunk;
        const VDouble dx = px - c.x, dz = pz - c.z, r2 = dx * dx + dz * dz;
        const VDouble above = (r2 - c.far_begin) * c.far_blend;
        DuneSums near;
        if (any(above < 1.0))
            dune_near<cubic, directed>(segments + c.first, segments + c.last, parts.softening2,
                                       parts.outer_sign, px, pz, near);
        if (any(above > 0.0)) {
            const VDouble t = vmin(vmax(above, VDouble{}), splat(1.0));
            dune_blend(c, t * t * (3.0 - 2.0 * t), dx, dz, r2 + parts.softening2, px, pz, near, sums);
        } else
            dune_add(near, sums);
    }
    return sums;
}

MARRAM_INLINE VDouble dune_ramp(const double* positions, const double* values, size_t count,
                                Ramp::Interpolation how, VDouble x) {
    VDouble y = splat(values[0]);
    for (size_t k = 0; k + 1 < count; ++k) {
        VDouble t = (x - positions[k]) / (positions[k + 1] - positions[k]);
        if (how == Ramp::Interpolation::constant) t = VDouble{};
        if (how == Ramp::Interpolation::smooth) t = t * t * (3.0 - 2.0 * t);
        const VDouble here = values[k] + t * (values[k + 1] - values[k]);
        y = x >= positions[k] ? here : y;
    }
    return x >= positions[count - 1] ? splat(values[count - 1]) : y;
}

// A slope's height at `x` of its width, 0 beyond the foot.
MARRAM_INLINE VDouble dune_slope(const Ramp& ramp, VDouble x, VDouble pinch) {
    VDouble pinched = x;
    if (any(pinch > 0.0)) {
        constexpr double least = 1e-300; // the logarithm's domain; below it x is 0
        const VDouble power = vexp(vlog(vmin(vmax(x, splat(least)), splat(1.0))) / (1.0 + pinch));
        pinched = pinch > 0.0 ? (x > least ? power : VDouble{}) : x;
    }
    const VDouble y = dune_ramp(ramp.positions().data(), ramp.values().data(), ramp.values().size(),
                                ramp.interpolation(), pinched);
    return x < 1.0 ? y : VDouble{};
}

// From the sums to what the dune says.
MARRAM_INLINE void dune_finish(const DuneParts& parts, const DuneSums& sums, DuneLanes& out) {
    const DuneSettings& s = parts.settings;
    const VDouble zero{}, one = splat(1.0), inverse = 1.0 / sums.weight;
    const VDouble D2 = 1.0 / vsqrt(0.75 * sums.weight), D = vsqrt(D2);
    const VDouble d = vsqrt(vmax(D2 - parts.softening2, zero));
    const VDouble t = vmin(vmax(0.5 + sums.side * inverse / D, zero), one);
    const VDouble b = t * t * (3.0 - 2.0 * t);
    const VDouble h = vmax(sums.height * inverse, zero), pinch = vmax(sums.pinch * inverse, zero);
    const VDouble wide_o = sums.outer * inverse;
    const VDouble wide_i = parts.cotangent > 0.0 ? h * parts.cotangent : sums.inner * inverse;
    const VDouble softening = splat(std::sqrt(parts.softening2));
    const VDouble xo = d / vmax(wide_o, softening), xi = d / vmax(wide_i, softening);
    const VDouble there = vmin(vmax(wide_o, wide_i) / softening, one);
    const VDouble so = dune_slope(s.outer_slope_shape, xo, pinch);
    const VDouble si =
        parts.cotangent > 0.0 ? vmax(1.0 - xi, zero) : dune_slope(s.inner_slope_shape, xi, pinch);
    out.height = h * there * (b * so + (1.0 - b) * si);
    const VDouble xm = s.max_dist > 0.0 ? d / s.max_dist : b * vmin(xo, one) + (1.0 - b) * vmin(xi, one);
    const VDouble mask = dune_ramp(s.mask_fall_off.positions().data(), s.mask_fall_off.values().data(),
                                   s.mask_fall_off.values().size(), s.mask_fall_off.interpolation(), xm);
    out.mask = xm < 1.0 ? vmin(vmax(mask, zero), one) : zero;
    out.outer = xo < 1.0 ? b : zero;
    out.inner = xi < 1.0 ? 1.0 - b : zero;
    out.dist = vmin(d, splat(parts.reach));
    const VDouble norm = vsqrt(sums.x * sums.x + sums.z * sums.z);
    const VLong in = (norm > 1e-9 * D * sums.weight) & ((out.outer + out.inner > 0.0) | (xm < 1.0));
    out.x = in ? sums.x / norm : zero;
    out.z = in ? sums.z / norm : zero;
}

struct DuneEval {
    // Of points in the dune's box, relative to its origin.
    MARRAM_HOT static void heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                   DuneLanes& out);
    MARRAM_HOT static void all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out);
};

MARRAM_HOT void DuneEval::heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                  DuneLanes& out) {
    const DuneSegment* segments = parts.segments.data();
    const DuneChunk *chunks = parts.chunks.data(), *end = chunks + parts.chunks.size();
    dune_finish(parts,
                parts.cubic ? dune_sums<true, false>(parts, segments, chunks, end, x, z)
                            : dune_sums<false, false>(parts, segments, chunks, end, x, z),
                out);
}

MARRAM_HOT void DuneEval::all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out) {
    const DuneSegment* segments = parts.segments.data();
    const DuneChunk *chunks = parts.chunks.data(), *end = chunks + parts.chunks.size();
    dune_finish(parts,
                parts.cubic ? dune_sums<true, true>(parts, segments, chunks, end, x, z)
                            : dune_sums<false, true>(parts, segments, chunks, end, x, z),
                out);
}

DuneSample dune_lane(const DuneLanes& out, int i) {
    return {out.height[i], out.mask[i], out.outer[i], out.inner[i], out.dist[i], Vec2d(out.x[i], out.z[i])};
}

} // namespace

DuneShape::DuneShape(std::span<const Vec2d> points, bool closed, const DuneSettings& settings)
    : digest_(dune_digest(points, closed, settings)) {
    parts_.settings = dune_within(settings);
    const DuneSettings& s = parts_.settings;
    parts_.outer_sign = s.flip ? -1.0 : 1.0;
    DuneLine line = dune_drawn(points, closed, parts_.origin);
    const double drawn = line.length();
    if (!(drawn > 0.0)) return;
    const double spacing = s.slope_width / s.search_accuracy;
    line = dune_fine(std::move(line), s, spacing, parts_.outer_sign);
    if (!(line.length() > 1e-12 * drawn)) return; // pushed into a point
    const std::vector<double> stations = dune_stations(line, s, spacing);
    const DuneRules rules{s, line.length(), spacing, line.closed};
    std::vector<DuneCrestPoint> crest;
    for (const double u : stations) {
        const Vec2d at = u >= 1.0 && line.closed ? line.at.front() : line.point(u * line.length());
        // A curve that turns back on itself has points in one place
        if (crest.empty() || (at - crest.back().at).norm() > 1e-12 * drawn) crest.push_back(rules.at(at, u));
    }
    if (crest.size() < 2) return;
    double highest = 0.0, widest = 0.0, longest = 0.0;
    dune_build_segments(rules, crest, parts_, highest);
    for (const DuneSegment& segment : parts_.segments) {
        longest = std::max(longest, segment.length);
        widest = std::max({widest, segment.outer[0], s.inner_slope_angle > 0.0 ? 0.0 : segment.inner[0]});
    }
    if (s.inner_slope_angle > 0.0) parts_.cotangent = 1.0 / std::tan(s.inner_slope_angle);
    const double softening = std::max(1e-3 * spacing, 1e-5 * longest);
    parts_.softening2 = softening * softening;
    parts_.reach = std::max({widest, highest * parts_.cotangent, s.max_dist, softening}) * (1.0 + 1e-9);
    dune_build_chunks(parts_);
    Vec2d lower, upper;
    dune_box(parts_, lower, upper);
    lower_ = lower + parts_.origin, upper_ = upper + parts_.origin;
}

std::vector<Vec2d> DuneShape::crest() const {
    std::vector<Vec2d> points;
    for (const DuneSegment& s : parts_.segments) points.push_back(Vec2d(s.x, s.z) + parts_.origin);
    return points;
}

std::vector<DuneCrestPoint> DuneShape::crest_points() const {
    std::vector<DuneCrestPoint> points;
    for (const DuneSegment& s : parts_.segments)
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

// Whether the dune is 0 between x0 and x1 of row z.
bool DuneShape::misses(double x0, double x1, double z) const {
    if (!(std::max(x0, x1) >= lower_.x() && std::min(x0, x1) <= upper_.x() && z >= lower_.y() &&
          z <= upper_.y()))
        return true;
    const double lower[2] = {std::min(x0, x1) - parts_.origin.x(), z - parts_.origin.y()};
    const double upper[2] = {std::max(x0, x1) - parts_.origin.x(), z - parts_.origin.y()};
    const double least = dune_least_weight(parts_);
    return dune_bound(parts_, lower, upper, least) <= least;
}

namespace {

// Calls miss(begin, end) and hit(begin, end, lanes) for stretches of a row: 64 samples are tried first, then 8.
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
            // Beyond the box all is 0, as it is on its edge
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
