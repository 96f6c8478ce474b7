// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/sweep.h"

#include <algorithm>

namespace marram::oracle {

namespace {

// Directions u cos(tau) + ahead sin(tau), |tau| <= half.
struct Range {
    Vec3d u, ahead;
    double half;
};

// True if a slab perpendicular to n and wider than c separates the points s0 to s1 from the triangle.
bool separated(const Range& range, double s0, double s1, double c, const Triangle& t, const Vec3d& n) {
    if (!(n.squaredNorm() > 0.5)) return false; // the zero vector of a degenerate triangle
    const double a = n.dot(range.u), b = n.dot(range.ahead);
    const double fixed = a * std::cos(range.half), turning = std::abs(b * std::sin(range.half));
    const bool turns_over = std::abs(std::atan2(-b, -a)) <= range.half; // the angle where the cosine is -1
    const double lowest = turns_over ? -std::hypot(a, b) : fixed - turning;
    return std::min(s0 * lowest, s1 * lowest) - std::max({n.dot(t.a), n.dot(t.b), n.dot(t.c)}) > c;
}

bool separated_by_any(const Range& range, double s0, double s1, double c, const Triangle& t,
                      const Vec3d& first) {
    if (separated(range, s0, s1, c, t, first)) return true;
    const Vec3d u = range.u;
    for (const Vec3d& n :
         {area_normal(t), Vec3d(u.cross(t.b - t.a)), Vec3d(u.cross(t.c - t.b)), Vec3d(u.cross(t.a - t.c))}) {
        const Vec3d unit = n.stableNormalized();
        if (separated(range, s0, s1, c, t, unit) || separated(range, s0, s1, c, t, -unit)) return true;
    }
    return false;
}

bool part_is_free(const Range& range, double s0, double s1, double c, const Triangle& t, int cuts) {
    const Closest nearest = closest(s0 * range.u, s1 * range.u, t);
    if (!(nearest.distance > c)) return false;
    if (nearest.distance - 2.0 * s1 * std::sin(0.5 * std::min(range.half, pi)) > c) return true;
    const Vec3d n = (nearest.on_segment - nearest.on_triangle) / nearest.distance;
    if (separated_by_any(range, s0, s1, c, t, n)) return true;
    const double middle = 0.5 * (s0 + s1);
    return cuts > 0 && part_is_free(range, s0, middle, c, t, cuts - 1) &&
           part_is_free(range, middle, s1, c, t, cuts - 1);
}

} // namespace

bool is_free(const Sweep& sweep, double angle, const Triangle& t) {
    const double distance = closest(Vec3d::Zero(), sweep.length * sweep.direction(angle), t).distance;
    return sweep.clearance > 0.0 ? distance >= sweep.clearance : distance > 0.0;
}

bool proven_free(const Sweep& sweep, double middle, double half, const Triangle& t) {
    constexpr double narrow = 1e-3; // rad; below it, splitting the segment is worth its cost
    const Range range{sweep.direction(middle), sweep.v * std::cos(middle) - sweep.u * std::sin(middle), half};
    return part_is_free(range, 0.0, sweep.length, sweep.clearance, t, half < narrow ? 4 : 0);
}

} // namespace marram::oracle
