// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/triangles.h"

#include "tests/oracle/predicates.h"

#include <algorithm>

namespace marram::oracle {
namespace {

// The length, to a rounding or two at any magnitude. The slower scaled norm is used only if squares would
// overflow or lose bits below the smallest normal number.
double length_of(const Vec3d& v) {
    const double squared = v.squaredNorm();
    return squared > 1e-280 && squared < 1e280 ? std::sqrt(squared) : v.stableNorm();
}

// Parameter of the point of ab nearest to p, in [0, 1].
double nearest_parameter(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d along = b - a;
    const double length = length_of(along);
    if (!(length > 0.0)) return 0.0;
    const Vec3d unit = along / length;
    return std::clamp(unit.dot(p - a) / length, 0.0, 1.0);
}

Vec3d at(const Vec3d& a, const Vec3d& b, double t) { return t == 1.0 ? b : Vec3d(a + t * (b - a)); }

void take_if_nearer(Closest& best, const Vec3d& on_segment, const Vec3d& on_triangle) {
    const double distance = length_of(on_segment - on_triangle);
    if (distance < best.distance) best = {distance, on_segment, on_triangle};
}

// The nearest points in the interior of both segments, if there are any; other candidates cover the ends. The
// closed form is noisy for nearly parallel lines, so it is refined by projecting back and forth once.
void take_inner_pair(Closest& best, const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const double length_p = length_of(q - p), length_a = length_of(b - a);
    if (!(length_p > 0.0) || !(length_a > 0.0)) return;
    const Vec3d u = (q - p) / length_p, v = (b - a) / length_a, from = p - a;
    const double sine_squared = u.cross(v).squaredNorm();
    if (!(sine_squared > 0.0)) return;
    const double s = (u.dot(v) * v.dot(from) - u.dot(from)) / sine_squared;
    const Vec3d first = at(p, q, std::clamp(s / length_p, 0.0, 1.0));
    const Vec3d on_edge = nearest_point_on_segment(first, a, b);
    take_if_nearer(best, first, on_edge);
    take_if_nearer(best, nearest_point_on_segment(on_edge, p, q), on_edge);
}

// Exact sign of the area of a, b, c projected along one axis: lifting one corner by 1 turns the area into a
// volume.
int orientation_seen_along(int axis, Vec3d a, Vec3d b, Vec3d c) {
    a[axis] = b[axis] = c[axis] = 0.0;
    Vec3d lifted = a;
    lifted[axis] = 1.0;
    return orientation(a, b, c, lifted);
}

bool segments_meet_in_plane(int axis, const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const int pa = orientation_seen_along(axis, a, b, p), qa = orientation_seen_along(axis, a, b, q);
    const int ap = orientation_seen_along(axis, p, q, a), bp = orientation_seen_along(axis, p, q, b);
    if (pa != 0 || qa != 0 || ap != 0 || bp != 0) return pa * qa <= 0 && ap * bp <= 0;
    for (int i = 0; i < 3; ++i) // on one line: intervals overlap on every axis
        if (i != axis &&
            (std::max(p[i], q[i]) < std::min(a[i], b[i]) || std::max(a[i], b[i]) < std::min(p[i], q[i])))
            return false;
    return true;
}

bool meets_in_plane(const Vec3d& p, const Vec3d& q, const Triangle& t) {
    int axis;
    area_normal(t).cwiseAbs().maxCoeff(&axis);
    if (segments_meet_in_plane(axis, p, q, t.a, t.b) || segments_meet_in_plane(axis, p, q, t.b, t.c) ||
        segments_meet_in_plane(axis, p, q, t.c, t.a))
        return true;
    const int ab = orientation_seen_along(axis, t.a, t.b, p), bc = orientation_seen_along(axis, t.b, t.c, p);
    return ab != 0 && ab == bc && ab == orientation_seen_along(axis, t.c, t.a, p);
}

bool degenerate(const Triangle& t) {
    for (int axis = 0; axis < 3; ++axis)
        if (orientation_seen_along(axis, t.a, t.b, t.c) != 0) return false;
    return true;
}

double line_distance(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const Vec3d across = (q - p).cross(b - a);
    const double size = length_of(across);
    return size > 0.0 ? std::abs(across.dot(a - p)) / size : 0.0;
}

} // namespace

Vec3d area_normal(const Triangle& t) { return (t.b - t.a).cross(t.c - t.a); }

Vec3d nearest_point_on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    return at(a, b, nearest_parameter(p, a, b));
}

Vec3d nearest_point_on_triangle(const Vec3d& p, const Triangle& t) {
    Closest best;
    take_if_nearer(best, p, nearest_point_on_segment(p, t.a, t.b));
    take_if_nearer(best, p, nearest_point_on_segment(p, t.b, t.c));
    take_if_nearer(best, p, nearest_point_on_segment(p, t.c, t.a));
    const Vec3d normal = area_normal(t).stableNormalized();
    const double ab = normal.dot((t.b - t.a).cross(p - t.a)), bc = normal.dot((t.c - t.b).cross(p - t.b)),
                 ca = normal.dot((t.a - t.c).cross(p - t.c)), whole = ab + bc + ca;
    if (ab > 0.0 && bc > 0.0 && ca > 0.0)
        take_if_nearer(best, p, t.a + (ca / whole) * (t.b - t.a) + (ab / whole) * (t.c - t.a));
    return best.on_triangle;
}

Closest closest(const Vec3d& p, const Vec3d& q, const Triangle& t) {
    if (crosses(p, q, t)) {
        const Vec3d normal = area_normal(t);
        const double hp = normal.dot(p - t.a), hq = normal.dot(q - t.a);
        const Vec3d x = hp == hq ? p : at(p, q, std::clamp(hp / (hp - hq), 0.0, 1.0));
        return {0.0, x, x};
    }
    Closest best;
    take_if_nearer(best, p, nearest_point_on_triangle(p, t));
    take_if_nearer(best, q, nearest_point_on_triangle(q, t));
    for (const Vec3d& corner : {t.a, t.b, t.c})
        take_if_nearer(best, nearest_point_on_segment(corner, p, q), corner);
    take_inner_pair(best, p, q, t.a, t.b);
    take_inner_pair(best, p, q, t.b, t.c);
    take_inner_pair(best, p, q, t.c, t.a);
    return best;
}

bool crosses(const Vec3d& p, const Vec3d& q, const Triangle& t) {
    const int side_p = orientation(t.a, t.b, t.c, p), side_q = orientation(t.a, t.b, t.c, q);
    if (side_p * side_q > 0) return false;
    if (side_p == 0 && side_q == 0) return !degenerate(t) && meets_in_plane(p, q, t);
    const int ab = orientation(p, q, t.a, t.b), bc = orientation(p, q, t.b, t.c),
              ca = orientation(p, q, t.c, t.a);
    return (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
}

Crossing crossing(const Vec3d& p, const Vec3d& q, const Triangle& t) {
    const Closest nearest = closest(p, q, t);
    const double length = length_of(q - p);
    const double parameter = length > 0.0 ? length_of(nearest.on_segment - p) / length : 0.0;
    if (!crosses(p, q, t)) return {false, parameter, nearest.distance};
    const Vec3d normal = area_normal(t).stableNormalized();
    const double margin =
        std::min({std::abs(normal.dot(p - t.a)), std::abs(normal.dot(q - t.a)), line_distance(p, q, t.a, t.b),
                  line_distance(p, q, t.b, t.c), line_distance(p, q, t.c, t.a)});
    return {true, parameter, margin};
}

} // namespace marram::oracle
