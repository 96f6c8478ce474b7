// SPDX-License-Identifier: Apache-2.0
// A segment of length l rotates about its start, the origin, in the plane of a and b: u(t) = a cos t + b sin
// t. It touches a triangle when their distance is the clearance c. The triangle inflated by c is convex, and
// so is its intersection with the plane of the turn; seen from outside it spans less than half a turn. So
// each triangle blocks one interval of angles, and the ends of that interval are among the angles at which
// the capsule touches one of the triangle's features. Every such contact solves
//
//     A cos t + B sin t = C    with R^2 = A^2 + B^2,  cos t = (A C -+ B w) / R^2,  sin t = (B C +- A w) / R^2,
//     w^2 = R^2 - C^2, or a quadratic in tan t: no trigonometric function is needed.
//
// Face, touched by the end of the segment:      N . l u = N . v +- c                       end above the triangle
// Vertex v, q = v^2 - c^2:  touched sideways    v . u = sqrt q                             where q <= l^2
//                           by the end          v . u = (l^2 + q) / 2 l                    where q > l^2
// Edge v + x e, touched sideways, g = e x v:    (g . u)^2 = c^2 (1 - (e . u)^2)            0 <= s <= l, 0 <= x <= |edge|
//     a homogeneous quadratic form in (cos, sin); its discriminant is c^2 (g_a^2 + g_b^2 - D^2 - c^2 (1 - e_a^2 - e_b^2))
//     with D = g_a e_b - g_b e_a, which loses no accuracy for small c.
// Edge, touched by the end:                     |e x (l u - v)|^2 = c^2                    a quartic
//     Rare: the edge must pass within c of the circle of the end. f(t), the left side minus the right, has
//     |f''| <= M with M = 2 l |e x v| + 2 l^2. f(t + d) >= f + f' d - M d^2 / 2, so a step to that parabola's
//     root never passes a root of f and converges quadratically. It is done from both sides of each interval
//     of angles at which the end is beside the edge.
//
// A parallel edge is touched at its vertices or by the end. A triangle without area has no face but three
// edges, and an edge without length is a vertex. Each such case is skipped, and the contact is found by the
// other features.
//
// A contact on the border of two features must not be lost from both by rounding. So the ranges of s and x,
// and the face, are widened by the rounding error of their computation. A contact found twice does no harm,
// and one that is outside the feature by a rounding error is still closer than c + 1e-10 l.
#include "procedural/wind/collision/contact.h"

#include "procedural/wind/collision/shortest.h"

#include <algorithm>

namespace marram {
namespace {

constexpr double rounding = 1e-14; // relative error of the computations here, with a margin

struct alignas(64) Touches { // extreme contact angles found so far
    VDouble positive_first, positive_last, negative_first, negative_last;
};

MARRAM_INLINE void take(Touches& touches, VDouble cosine, VDouble sine, VLong valid) {
    const VDouble ac = vabs(cosine), as = vabs(sine);
    const VDouble sum = ac + as;
    const VDouble across = as / select(sum > 0.0, sum, 1.0);
    const VDouble p = select(cosine < 0.0, 2.0 - across, across);
    const VLong positive = valid & (sine >= 0.0), negative = valid & (sine < 0.0);
    touches.positive_first = vmin(touches.positive_first, select(positive, p, infinity));
    touches.positive_last = vmax(touches.positive_last, select(positive, p, -infinity));
    touches.negative_first = vmax(touches.negative_first, select(negative, -p, -infinity));
    touches.negative_last = vmin(touches.negative_last, select(negative, -p, infinity));
}

struct alignas(64) Plane8 { // the capsule, for eight lanes
    Wide3d from, across;
    VDouble length, clearance;
};

// Both solutions of A cos + B sin = C, filtered by `accept(cos, sin)`.
template <typename Accept>
MARRAM_INLINE void solve(VDouble a, VDouble b, VDouble c, VLong valid, Touches& touches, Accept&& accept) {
    const VDouble rr = a * a + b * b;
    const VDouble ww = rr - c * c;
    valid &= (ww >= 0.0) & (rr > 0.0);
    const VDouble w = vsqrt(vmax(ww, VDouble{}));
    const VDouble inverse = 1.0 / select(rr > 0.0, rr, 1.0);
    const VDouble c1 = (a * c - b * w) * inverse, s1 = (b * c + a * w) * inverse;
    const VDouble c2 = (a * c + b * w) * inverse, s2 = (b * c - a * w) * inverse;
    take(touches, c1, s1, valid & accept(c1, s1));
    take(touches, c2, s2, valid & accept(c2, s2));
}

MARRAM_INLINE void vertex_touches(const Plane8& plane, const Wide3d& v, Touches& touches) {
    const VDouble q = dot(v, v) - plane.clearance * plane.clearance;
    const VDouble l = plane.length;
    const VDouble reach = select(q <= l * l, vsqrt(vmax(q, VDouble{})), (l * l + q) / (2.0 * l));
    const auto all = [](VDouble, VDouble) MARRAM_ALWAYS_INLINE { return all_lanes; };
    solve(dot(v, plane.from), dot(v, plane.across), reach, all_lanes, touches, all);
}

MARRAM_INLINE void face_touches(const Plane8& plane, const Triangles8& t, Touches& touches) {
    const Wide3d &v0 = t.corner[0], &v1 = t.corner[1], &v2 = t.corner[2];
    const Wide3d e[3] = {v1 - v0, v2 - v1, v0 - v2};
    Wide3d n = cross(e[0], e[1]);
    const VDouble nn = dot(n, n), e0 = dot(e[0], e[0]), e1 = dot(e[1], e[1]), e2 = dot(e[2], e[2]);
    const VDouble longest = vmax(e0, vmax(e1, e2));
    const VLong has_area = nn > rounding * rounding * longest * longest;
    n = n * (1.0 / vsqrt(select(has_area, nn, 1.0)));
    const VDouble l = plane.length, height = dot(n, v0);
    const VDouble a = dot(n, plane.from) * l, b = dot(n, plane.across) * l;
    const Wide3d inward[3] = {cross(n, e[0]), cross(n, e[1]), cross(n, e[2])};
    const auto above = [&](VDouble cosine, VDouble sine) MARRAM_ALWAYS_INLINE {
        const Wide3d end = (plane.from * cosine + plane.across * sine) * l;
        VLong inside = all_lanes;
        for (int i = 0; i < 3; ++i) {
            const Wide3d from_corner = end - t.corner[i];
            const VDouble slack =
                rounding * vsqrt(dot(inward[i], inward[i])) * (l + vsqrt(dot(t.corner[i], t.corner[i])));
            inside &= dot(inward[i], from_corner) >= -slack;
        }
        return inside;
    };
    solve(a, b, height + plane.clearance, has_area, touches, above);
    solve(a, b, height - plane.clearance, has_area, touches, above);
}

MARRAM_INLINE void edge_touches(const Plane8& plane, const Wide3d& v, const Wide3d& end, Touches& touches) {
    Wide3d e = end - v;
    const VDouble ee = dot(e, e);
    const VLong has_length = ee > 0.0;
    const VDouble size = vsqrt(ee);
    e = e * (1.0 / select(has_length, size, 1.0));
    const Wide3d g = cross(e, v);
    const VDouble c = plane.clearance, cc = c * c;
    const VDouble ga = dot(g, plane.from), gb = dot(g, plane.across);
    const VDouble ea = dot(e, plane.from), eb = dot(e, plane.across);
    const VDouble d = ga * eb - gb * ea;
    const VDouble inner = ga * ga + gb * gb - d * d - cc * vmax(1.0 - ea * ea - eb * eb, VDouble{});
    const VLong meets = has_length & (inner >= 0.0);
    const VDouble root = c * vsqrt(vmax(inner, VDouble{}));
    const VDouble qa = ga * ga + cc * (ea * ea - 1.0), qb = gb * gb + cc * (eb * eb - 1.0);
    const VDouble qc = ga * gb + cc * ea * eb;
    const VDouble z = select(qc < 0.0, root - qc, -qc - root);
    const VDouble ve = dot(v, e), va = dot(v, plane.from), vb = dot(v, plane.across);
    const VDouble reach = vsqrt(dot(v, v)) + size + plane.length;
    for (int i = 0; i < 2; ++i) {
        VDouble cosine = i == 0 ? qb : z, sine = i == 0 ? z : qa;
        const VDouble norm = vsqrt(cosine * cosine + sine * sine);
        VLong valid = meets & (norm > 0.0);
        const VDouble inverse = 1.0 / select(norm > 0.0, norm, 1.0);
        cosine = cosine * inverse;
        sine = sine * inverse;
        const VDouble ue = ea * cosine + eb * sine, slant = 1.0 - ue * ue;
        valid &= slant > rounding;
        const VDouble per_slant = 1.0 / select(slant > rounding, slant, 1.0);
        VDouble s = (va * cosine + vb * sine - ve * ue) * per_slant;
        const VDouble x = s * ue - ve; // both change sign with u: x does not
        const VLong behind = s < 0.0;
        s = vabs(s);
        cosine = select(behind, -cosine, cosine);
        sine = select(behind, -sine, sine);
        const VDouble slack = rounding * reach * per_slant;
        valid &= (s <= plane.length + slack) & (x >= -slack) & (x <= size + slack);
        take(touches, cosine, sine, valid);
    }
}

// True: the edge comes within the clearance of the circle of the segment's end. Rarely true.
MARRAM_INLINE VLong end_may_touch(const Plane8& plane, const Wide3d& normal, const Wide3d& v,
                                  const Wide3d& end) {
    const VDouble c = plane.clearance * (1.0 + rounding) + plane.length * rounding;
    // The part of the edge within c of the plane ...
    const VDouble h0 = dot(v, normal), h1 = dot(end, normal), rise = h1 - h0;
    const VLong level = vabs(rise) <= rounding * (vabs(h0) + vabs(h1));
    const VDouble per_rise = 1.0 / select(level, 1.0, rise);
    const VDouble x0 = (-c - h0) * per_rise, x1 = (c - h0) * per_rise;
    const VDouble low = select(level, 0.0, vmax(vmin(x0, x1), VDouble{}));
    const VDouble high = select(level, 1.0, vmin(vmax(x0, x1), 1.0));
    const VLong near_plane = (low <= high) & select(level, vabs(h0) <= c * 2.0, all_lanes);
    // ... and its smallest and largest distance from the pivot.
    const Wide3d e = end - v;
    const VDouble ee = dot(e, e), ve = dot(v, e), vv = dot(v, v);
    const auto squared = [&](VDouble x) MARRAM_ALWAYS_INLINE { return vv + x * (2.0 * ve + x * ee); };
    const VDouble nearest = vmin(vmax(-ve / select(ee > 0.0, ee, 1.0), low), high);
    const VDouble most = vmax(squared(low), squared(high)), least = squared(nearest);
    const VDouble outer = plane.length + c, inner = vmax(plane.length - c, VDouble{});
    const double wide = 1.0 + 16.0 * rounding;
    return near_plane & (least <= outer * outer * wide) & (most * wide >= inner * inner);
}

// ---- the end against an edge: one lane at a time ----

struct EndOnEdge { // f(t) = k + p cos t + q sin t - (ea cos t + eb sin t)^2 l^2
    double k, p, q, ea, eb, curvature;

    double value(double t, double& slope) const {
        const double c = std::cos(t), s = std::sin(t), along = ea * c + eb * s;
        slope = q * c - p * s - 2.0 * along * (eb * c - ea * s);
        return k + p * c + q * s - along * along;
    }
};

// If an edge runs along the circle of the end, f is almost the parabola and steps are short.
constexpr int max_steps = 20000;

// The first root at or after `begin` in direction `sense` before `end`; infinity if there is none.
double first_root(const EndOnEdge& f, double begin, double end, double sense, double enough) {
    double t = begin;
    for (int i = 0; i < max_steps; ++i) {
        double slope;
        const double value = f.value(t, slope);
        if (value <= enough) return t;
        slope *= sense;
        t += sense * (slope + std::sqrt(slope * slope + 2.0 * f.curvature * value)) / f.curvature;
        if ((end - t) * sense < 0.0) return infinity;
    }
    return t; // slow convergence means grazing contact: stop before it
}

// Angles at which the projection of the end onto the edge's line lies within the edge.
int turns_beside(double a, double b, double offset, double size, double out[3][2]) {
    const double r = std::hypot(a, b), middle = std::atan2(b, a);
    const double low = offset, high = size + offset; // low <= r cos(t - middle) <= high
    if (low > r || high < -r || r == 0.0) {
        if (r == 0.0 && low <= 0.0 && high >= 0.0) {
            out[0][0] = -pi;
            out[0][1] = pi;
            return 1;
        }
        return 0;
    }
    const double wide = std::acos(std::clamp(low / r, -1.0, 1.0)),
                 narrow = std::acos(std::clamp(high / r, -1.0, 1.0));
    if (narrow <= 0.0) {
        out[0][0] = middle - wide;
        out[0][1] = middle + wide;
        return 1;
    }
    out[0][0] = middle + narrow;
    out[0][1] = middle + wide;
    out[1][0] = middle - wide;
    out[1][1] = middle - narrow;
    return 2;
}

void take_one(Touches& touches, int lane, double t) {
    const double p = diamond(std::cos(t), std::sin(t));
    if (p >= 0.0) {
        touches.positive_first[lane] = std::min(touches.positive_first[lane], p);
        touches.positive_last[lane] = std::max(touches.positive_last[lane], p);
    } else {
        touches.negative_first[lane] = std::max(touches.negative_first[lane], p);
        touches.negative_last[lane] = std::min(touches.negative_last[lane], p);
    }
}

void end_touches(const TurningCapsule& capsule, const Vec3d& v, const Vec3d& other, Touches& touches,
                 int lane) {
    const double size = (other - v).norm();
    if (!(size > 0.0)) return;
    const Vec3d e = (other - v) / size;
    const double l = capsule.length, c = capsule.clearance;
    const Vec3d across = v - e * v.dot(e); // from the pivot to the line, perpendicular to it
    EndOnEdge f{};
    f.ea = e.dot(capsule.from) * l;
    f.eb = e.dot(capsule.across) * l;
    f.p = -2.0 * l * across.dot(capsule.from);
    f.q = -2.0 * l * across.dot(capsule.across);
    f.k = across.squaredNorm() + l * l - c * c;
    f.curvature = std::hypot(f.p, f.q) + 2.0 * (f.ea * f.ea + f.eb * f.eb);
    if (!(f.curvature > 0.0)) return;
    const double enough = rounding * (across.squaredNorm() + l * l);
    double windows[3][2];
    const int count = turns_beside(f.ea, f.eb, v.dot(e), size, windows);
    // Blocked angles may extend into a window from both of its ends. The angle between, at which the end is
    // farthest from the line, is free because the pivot is: windows are split there.
    const double farthest = std::atan2(f.q, f.p);
    const auto search = [&](double begin, double end) {
        const double first = first_root(f, begin, end, 1.0, enough);
        if (first == infinity) return;
        take_one(touches, lane, first);
        take_one(touches, lane, first_root(f, end, begin, -1.0, enough));
    };
    for (int i = 0; i < count; ++i) {
        const double begin = windows[i][0], end = windows[i][1];
        const double cut =
            begin + std::remainder(farthest - begin - pi, 2.0 * pi) + pi; // begin ... begin + 2 pi
        if (cut > begin && cut < end) {
            search(begin, cut);
            search(cut, end);
        } else {
            search(begin, end);
        }
    }
}

Vec3d lane_of(const Wide3d& v, int lane) { return {v.x[lane], v.y[lane], v.z[lane]}; }

MARRAM_HOT void touches_of(const TurningCapsule& capsule, const Triangles8& triangles, Touches& touches,
                           VLong& end_edges) {
    const Plane8 plane{splat3(capsule.from.data()), splat3(capsule.across.data()), splat(capsule.length),
                       splat(capsule.clearance)};
    const Wide3d normal = splat3(capsule.normal.data());
    touches = {splat(infinity), splat(-infinity), splat(-infinity), splat(infinity)};
    face_touches(plane, triangles, touches);
    end_edges = VLong{};
    for (int i = 0; i < 3; ++i) {
        const Wide3d &v = triangles.corner[i], &next = triangles.corner[(i + 1) % 3];
        vertex_touches(plane, v, touches);
        edge_touches(plane, v, next, touches);
        end_edges |= end_may_touch(plane, normal, v, next) & (1 << i);
    }
}

// The tested range of the turn, and half-spaces that contain its sector. Unit vectors; if the range is wider
// than half a turn they are 0 and exclude nothing.
struct Wedge {
    Vec3d begin, end;     // directions at the two ends of the range
    Vec3d behind, beyond; // perpendicular to those, outwards
    Vec3d back;           // opposite to its middle
    bool narrow;          // at most half a turn wide
};

Wedge wedge_of(const TurningCapsule& capsule, double begin, double end) {
    const Vec2d b = from_diamond(begin), e = from_diamond(end);
    Wedge wedge{capsule.direction(b.x(), b.y()),
                capsule.direction(e.x(), e.y()),
                Vec3d::Zero(),
                Vec3d::Zero(),
                Vec3d::Zero(),
                end - begin <= 2.0};
    if (!wedge.narrow) return wedge;
    wedge.behind = capsule.from * b.y() - capsule.across * b.x();
    wedge.beyond = capsule.across * e.x() - capsule.from * e.y();
    const Vec3d middle = wedge.begin + wedge.end;
    if (middle.squaredNorm() > 1e-6)
        wedge.back = -middle.normalized(); // else it is half a turn and has no half-space behind it
    return wedge;
}

// The wedge, for eight lanes.
struct alignas(64) Wedge8 {
    Wide3d begin, end, behind, beyond, from, across;
    VDouble length, clearance; // with a margin for rounding
    bool narrow;

    MARRAM_INLINE Wedge8(const TurningCapsule& capsule, const Wedge& wedge)
        : begin(splat3(wedge.begin.data())), end(splat3(wedge.end.data())),
          behind(splat3(wedge.behind.data())), beyond(splat3(wedge.beyond.data())),
          from(splat3(capsule.from.data())), across(splat3(capsule.across.data())),
          length(splat(capsule.length)),
          clearance(splat(capsule.clearance * (1.0 + rounding) + capsule.length * rounding)),
          narrow(wedge.narrow) {}

    // Extent of the sector along n: at the pivot, at one of its ends, or where n itself points into it.
    MARRAM_INLINE VDouble reach(const Wide3d& n) const {
        VDouble most = vmax(vmax(dot(n, begin), dot(n, end)), VDouble{});
        const VLong peaks = narrow ? (dot(n, behind) <= 0.0) & (dot(n, beyond) <= 0.0) : all_lanes;
        if (any(peaks)) {
            const VDouble a = dot(n, from), b = dot(n, across);
            most = select(peaks, vsqrt(a * a + b * b), most);
        }
        return most * length;
    }
};

// `may`: the triangles that may be touched within the wedge. Excludes those entirely on the far side of one
// of its half-spaces or of the plane of the turn, and those whose own plane has the sector on one side,
// farther away than the clearance.
MARRAM_HOT void may_touch(const TurningCapsule& capsule, const Wedge& wedge, const Triangles8& triangles,
                          VLong& may) {
    const Wedge8 wide(capsule, wedge);
    const VDouble c = wide.clearance;
    const Wide3d normal = splat3(capsule.normal.data()), back = splat3(wedge.back.data());
    VLong above = all_lanes, below = above, before = above, after = above, backwards = above;
    for (const Wide3d& v : triangles.corner) {
        const VDouble h = dot(v, normal);
        above &= h > c;
        below &= h < -c;
        before &= dot(v, wide.behind) > c;
        after &= dot(v, wide.beyond) > c;
        backwards &= dot(v, back) > c;
    }
    const Wide3d &v0 = triangles.corner[0], e0 = triangles.corner[1] - v0, e1 = triangles.corner[2] - v0;
    Wide3d n = cross(e0, e1);
    const VDouble size = vsqrt(dot(n, n)), height = dot(n, v0);
    n = n * select(height < 0.0, -1.0, 1.0); // away from the pivot
    const VLong apart = (vabs(height) - wide.reach(n) > size * c) & (size > 0.0);
    may = ~(above | below | before | after | backwards | apart);
}

// The same with the plane perpendicular to the shortest vector from the segment at the wedge's end: it
// separates triangles that lie beside the point of contact.
MARRAM_HOT void may_touch_at_end(const TurningCapsule& capsule, const Wedge& wedge,
                                 const Triangles8& triangles, VLong& may) {
    const Wedge8 wide(capsule, wedge);
    const Wide3d n = shortest_vector(Wide3d{}, wide.end * wide.length, triangles).v;
    const VDouble nearest =
        vmin(dot(n, triangles.corner[0]), vmin(dot(n, triangles.corner[1]), dot(n, triangles.corner[2])));
    may &= ~(nearest - wide.reach(n) > vsqrt(dot(n, n)) * wide.clearance);
}

// The blocked interval of a triangle from its extreme contact angles.
bool interval_of(const Touches& touches, int lane, Blocked& out) {
    const double pf = touches.positive_first[lane], pl = touches.positive_last[lane];
    const double nf = touches.negative_first[lane], nl = touches.negative_last[lane];
    const bool positive = pf <= pl, negative = nl <= nf;
    if (!positive && !negative) return false;
    if (!negative)
        out = {pf, pl};
    else if (!positive)
        out = {4.0 + nl, 4.0 + nf};
    else if (pf - nf > 2.0) // contains pi
        out = {pf, 4.0 + nf};
    else
        out = {nl, pl};
    return true;
}

} // namespace

MARRAM_HOT bool clear_of_pivot(std::span<Triangles8> triangles, double clearance) {
    const VDouble c = splat(clearance);
    VLong near{};
    for (const Triangles8& t : triangles) {
        const Wide3d &v0 = t.corner[0], &v1 = t.corner[1], &v2 = t.corner[2];
        const Wide3d n = cross(v1 - v0, v2 - v0);
        const VDouble h = dot(n, v0);
        const auto aside = [&](VDouble a, VDouble b, VDouble d) MARRAM_ALWAYS_INLINE {
            return (vmin(a, vmin(b, d)) > c) | (vmax(a, vmax(b, d)) < -c);
        };
        const VLong away = aside(v0.x, v1.x, v2.x) | aside(v0.y, v1.y, v2.y) | aside(v0.z, v1.z, v2.z);
        near |= (h * h <= dot(n, n) * (c * c)) & ~away;
    }
    return !any(near);
}

namespace {

// First angle at which an edge crosses the plane of the turn within the segment's length.
MARRAM_HOT void first_crossing(const TurningCapsule& capsule, const Triangles8& t, VDouble& first) {
    const Wide3d normal = splat3(capsule.normal.data());
    const Wide3d from = splat3(capsule.from.data()), across = splat3(capsule.across.data());
    const VDouble ll = splat(capsule.length * capsule.length);
    VDouble h[3], a[3], b[3];
    for (int i = 0; i < 3; ++i) {
        h[i] = dot(t.corner[i], normal);
        a[i] = dot(t.corner[i], from);
        b[i] = dot(t.corner[i], across);
    }
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3;
        const VLong crosses = ((h[i] < 0.0) & (h[j] >= 0.0)) | ((h[i] >= 0.0) & (h[j] < 0.0));
        const VDouble s = h[i] / select(crosses, h[i] - h[j], 1.0);
        const VDouble x = a[i] + (a[j] - a[i]) * s, y = b[i] + (b[j] - b[i]) * s;
        const VDouble size = vabs(x) + vabs(y);
        const VDouble p = y / select(size > 0.0, size, 1.0);
        const VLong valid = crosses & (y >= 0.0) & (size > 0.0) & (x * x + y * y <= ll);
        const VDouble turn = select(x < 0.0, 2.0 - p, p);
        first = select(valid & (turn < first), turn, first);
    }
}

// First angle at which a vertex touches. A vertex v blocks the angles t with v . u(t) > reach, see above:
// those around its direction.
MARRAM_HOT void first_vertex(const TurningCapsule& capsule, const Triangles8& triangles, VDouble& first) {
    const Wide3d from = splat3(capsule.from.data()), across = splat3(capsule.across.data());
    const VDouble l = splat(capsule.length), ll = l * l, cc = splat(capsule.clearance * capsule.clearance);
    const VDouble zero{}, one = splat(1.0);
    for (const Wide3d& v : triangles.corner) {
        const VDouble q = dot(v, v) - cc;
        const VDouble reach = select(q <= ll, vsqrt(vmax(q, zero)), (ll + q) / (2.0 * l));
        const VDouble a = dot(v, from), b = dot(v, across);
        const VDouble ww = a * a + b * b - reach * reach;
        const VLong touches = ww > 0.0;
        const VDouble w = vsqrt(select(touches, ww, zero));
        // Start of its interval, times a^2 + b^2.
        const VDouble c1 = a * reach + b * w, s1 = b * reach - a * w;
        const VDouble size = vabs(c1) + vabs(s1);
        const VDouble p = vabs(s1) / select(size > 0.0, size, one);
        const VDouble turn = select(s1 < 0.0, zero, select(c1 < 0.0, 2.0 - p, p));
        // If it starts before angle 0, it blocks angle 0 or only negative angles.
        const VLong valid = touches & ((s1 >= 0.0) | (a > reach));
        first = select(valid & (turn < first), turn, first);
    }
}

// Upper bound on the first contact with any of them: where a vertex touches or, on coarse meshes, where the
// axis of the segment meets an edge; `end` if neither does.
double contact_upper_bound(const TurningCapsule& capsule, double end, std::span<Triangles8> triangles) {
    for (const auto bound : {first_vertex, first_crossing}) {
        VDouble first = splat(end);
        for (const Triangles8& t : triangles) bound(capsule, t, first);
        double least = end;
        for (int i = 0; i < lanes; ++i) least = std::min(least, double(first[i]));
        if (least < end) return least;
    }
    return end;
}

// Calls `take` with the interval of every triangle that blocks an angle between `begin` and `end`. `take` may
// reduce `end`, which skips triangles still to come, or return false to stop. At the call the triangle is in
// a lane of `dense`.
template <typename Take>
void each_blocked(const TurningCapsule& capsule, double begin, double end, std::span<Triangles8> triangles,
                  size_t count, bool late, Triangles8& dense, Take&& take) {
    Wedge wedge = wedge_of(capsule, begin, end);
    int filled = 0;
    const auto flush = [&] {
        if (filled == 0) return true;
        for (int lane = filled; lane < lanes; ++lane)
            for (Wide3d& p : dense.corner) {
                p.x[lane] = p.x[0];
                p.y[lane] = p.y[0];
                p.z[lane] = p.z[0];
            }
        Touches touches;
        VLong end_edges;
        touches_of(capsule, dense, touches, end_edges);
        const double before = end;
        Blocked blocked{};
        if (late) {
            // Every touch is a contact: the closed forms avoid most searches for the end on an edge.
            for (int lane = 0; lane < filled; ++lane)
                if (interval_of(touches, lane, blocked) && !take(blocked, lane, end)) return false;
            if (any(end_edges)) {
                VLong may = all_lanes;
                may_touch_at_end(capsule, wedge_of(capsule, begin, end), dense, may);
                end_edges &= may;
            }
        }
        for (int lane = 0; lane < filled; ++lane) {
            if (late && end_edges[lane] == 0) continue;
            for (int i = 0; i < 3; ++i)
                if (end_edges[lane] & (1 << i)) [[unlikely]]
                    end_touches(capsule, lane_of(dense.corner[i], lane),
                                lane_of(dense.corner[(i + 1) % 3], lane), touches, lane);
            if (interval_of(touches, lane, blocked) && !take(blocked, lane, end)) return false;
        }
        filled = 0;
        if (end < before) wedge = wedge_of(capsule, begin, end);
        return true;
    };
    for (size_t i = 0; i < triangles.size(); ++i) {
        VLong may;
        may_touch(capsule, wedge, triangles[i], may);
        if (late && any(may)) may_touch_at_end(capsule, wedge, triangles[i], may);
        if (!any(may)) continue;
        const int used = int(std::min<size_t>(count - i * lanes, lanes));
        for (int lane = 0; lane < used; ++lane) {
            if (!may[lane]) continue;
            for (int k = 0; k < 3; ++k) {
                dense.corner[k].x[filled] = triangles[i].corner[k].x[lane];
                dense.corner[k].y[filled] = triangles[i].corner[k].y[lane];
                dense.corner[k].z[filled] = triangles[i].corner[k].z[lane];
            }
            if (++filled == lanes && !flush()) return;
        }
    }
    flush();
}

} // namespace

void blocked_turns(const TurningCapsule& capsule, double begin, double end, std::span<Triangles8> triangles,
                   size_t count, std::vector<Blocked>& out) {
    Triangles8 dense;
    each_blocked(capsule, begin, end, triangles, count, false, dense,
                 [&](const Blocked& blocked, int, double&) {
                     out.push_back(blocked);
                     return true;
                 });
}

bool first_blocked(const TurningCapsule& capsule, double end, TriangleList& triangles, FirstBlocked& found) {
    double& first = found.turn;
    first = infinity;
    TriangleList& near = found.near;
    near.clear();
    const Wedge wedge = wedge_of(capsule, 0.0, end);
    const std::span<Triangles8> all = triangles.blocks();
    for (size_t i = 0; i < all.size(); ++i) {
        VLong may;
        may_touch(capsule, wedge, all[i], may);
        if (!any(may)) continue;
        for (size_t lane = 0; lane < lanes && i * lanes + lane < triangles.size(); ++lane)
            if (may[lane]) near.push(all[i], int(lane));
    }
    if (near.size() == 0) return false;
    for (Vec3d& corner : found.corner) corner.setConstant(std::numeric_limits<double>::quiet_NaN());
    double certain = end;
    if (near.size() > 1) certain = contact_upper_bound(capsule, end, near.blocks());
    Triangles8 dense;
    each_blocked(capsule, 0.0, certain, near.blocks(), near.size(), certain < end, dense,
                 [&](const Blocked& blocked, int lane, double& nearer) {
                     if (blocked.low < first) {
                         first = blocked.low;
                         for (int k = 0; k < 3; ++k) found.corner[k] = lane_of(dense.corner[k], lane);
                     }
                     nearer = std::max(std::min(nearer, first), 0.0);
                     return first >= 0.0;
                 });
    if (first > certain && certain < end) first = certain; // only if rounding hides its contact
    return first <= end;
}

} // namespace marram
