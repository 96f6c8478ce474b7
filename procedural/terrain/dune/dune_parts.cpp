// SPDX-License-Identifier: Apache-2.0
// Builds the data that evaluation reads: the segments of the curve in the plain and the stretched plane, runs
// of eight of them, and the ramps. The model is in dune_shape.cpp.
#include "procedural/terrain/dune/dune_construction.h"
#include "procedural/terrain/dune/dune_profile.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr int dune_run = 8; // segments
static_assert(dune_run == lanes);

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
    const double begin = 10.0 * std::max(field.reach, c.radius); // "Far field" in dune_evaluation.cpp
    c.far_begin = begin * begin;
    c.far_blend = 1.0 / (0.21 * c.far_begin); // to 1.1 times the distance
    return c;
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

} // namespace

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

} // namespace marram
