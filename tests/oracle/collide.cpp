// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/collide.h"

#include "tests/oracle/turn.h"

#include <algorithm>

namespace marram::oracle {
namespace {

double angle_between(const Vec3d& a, const Vec3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

// Signed angle about `axis` to the nearer free direction in the plane.
std::optional<double> nearer_free(const Vec3d& pivot, const Vec3d& start, const Vec3d& axis, double length,
                                  double c, const TriangleSet& set) {
    const auto forward = first_free(pivot, start, axis, length, c, set);
    if (!forward) return std::nullopt;
    const auto back = first_free(pivot, start, -axis, length, c, set);
    return back && *back < *forward ? -*back : *forward;
}

// Axis of the rotation straight out: from the start towards the direction from the nearest triangle to the
// pivot. 0 if they are parallel.
Vec3d straight_axis(const Vec3d& pivot, const Vec3d& start, double reach, const TriangleSet& set) {
    const Nearest nearest = set.nearest(pivot, pivot, reach);
    if (nearest.triangle < 0) return Vec3d::Zero();
    const Vec3d away = pivot - nearest_point_on_triangle(pivot, set.triangles()[size_t(nearest.triangle)]);
    const Vec3d axis = start.cross(away);
    return axis.norm() > 1e-6 * away.norm() ? Vec3d(axis.normalized()) : Vec3d(Vec3d::Zero());
}

// Rotates the segment out of the colliders; false if no plane has a free direction.
bool rotate_out(SegmentTurn& turn, const Vec3d& pivot, const Vec3d& start, const Vec3d& axis, double length,
                double c, const TriangleSet& set, bool straight_out) {
    if (!is_free(pivot, start, 0.0, c, set)) return false; // the pivot is too close, so no direction is free
    constexpr int planes = 8;
    for (int j = 0; j < planes; ++j) {
        const Vec3d across = turned(axis, start, j * pi / planes);
        auto out = nearer_free(pivot, start, across, length, c, set);
        Vec3d about = across;
        if (j == 0 && straight_out) {
            const Vec3d straight = straight_axis(pivot, start, length, set);
            const auto other =
                straight.isZero(0.0) ? std::nullopt : nearer_free(pivot, start, straight, length, c, set);
            if (other && (!out || std::abs(*other) < std::abs(*out))) {
                out = other;
                about = straight;
            }
        }
        if (!out) continue;
        turn.out_angle = std::abs(*out);
        turn.direction = turned(start, about, *out).normalized();
        return true;
    }
    return false;
}

} // namespace

SegmentTurn turn_segment(const Vec3d& pivot, const Vec3d& start, const Vec3d& goal, const Vec3d& tip,
                         double length, double clearance, const TriangleSet& set, double margin,
                         bool straight_out) {
    SegmentTurn result;
    const Vec3d none = Vec3d::Zero();
    const Turn whole = shortest_turn(start, goal, start, tip, none);
    result.direction = start;
    result.goal_angle = result.remaining = whole.angle;
    result.axis = whole.axis;
    result.start_free = is_free(pivot, start, length, clearance, set);
    if (!result.start_free &&
        !rotate_out(result, pivot, start, whole.axis, length, clearance, set, straight_out)) {
        result.unresolved = true;
        return result;
    }
    const Vec3d from = result.direction;
    const Turn rest = shortest_turn(from, goal, from, tip, none);
    result.contact = first_contact(pivot, from, rest.axis, rest.angle, length, clearance, set, margin);
    result.direction = turned(from, rest.axis, result.contact.angle).normalized();
    result.remaining = angle_between(result.direction, goal);
    const Turn made = shortest_turn(start, result.direction, start, tip, none);
    result.axis = result.start_free ? whole.axis : made.axis;
    result.angle = result.start_free ? result.contact.angle : made.angle;
    return result;
}

StrandTurn collide_strand(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& targets,
                          const std::vector<double>& clearances, const TriangleSet& set, double margin,
                          bool straight_out) {
    StrandTurn result;
    result.cvs.push_back(rest.front());
    Eigen::Quaterniond carried = Eigen::Quaterniond::Identity();
    for (size_t k = 0; k + 1 < rest.size(); ++k) {
        const Vec3d pivot = result.cvs.back(), along = rest[k + 1] - rest[k], way = targets[k + 1] - pivot;
        const double length = along.stableNorm();
        SegmentTurn turn;
        if (length > 0.0) {
            const Vec3d start = (carried * along.stableNormalized()).normalized();
            const Vec3d goal = way.isZero(0.0) ? start : way.stableNormalized();
            turn = turn_segment(pivot, start, goal, carried * (rest.back() - rest[k]), length, clearances[k],
                                set, margin, straight_out);
            carried = (Eigen::Quaterniond(Eigen::AngleAxisd(turn.angle, turn.axis)) * carried).normalized();
        }
        result.cvs.push_back(pivot + length * turn.direction);
        result.segments.push_back(turn);
        result.unresolved += turn.unresolved ? 1 : 0;
        result.turned += std::max(0.0, turn.goal_angle - turn.remaining);
        result.goal += turn.goal_angle;
    }
    return result;
}

} // namespace marram::oracle
