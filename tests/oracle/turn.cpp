// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/turn.h"

namespace marram::oracle {
namespace {

constexpr double parallel_sine = 1e-14; // some tens of roundings of a unit vector

// unit(a x b) if a and b are not parallel.
bool unit_cross(const Vec3d& a, const Vec3d& b, Vec3d& axis) {
    const Vec3d cross = a.stableNormalized().cross(b.stableNormalized());
    if (!(cross.norm() > parallel_sine)) return false;
    axis = cross.normalized();
    return true;
}

} // namespace

Turn shortest_turn(const Vec3d& from, const Vec3d& to, const Vec3d& segment, const Vec3d& tip,
                   const Vec3d& noise) {
    Turn turn;
    if (from.isZero(0.0) || to.isZero(0.0)) return turn;
    const Vec3d a = from.stableNormalized(), b = to.stableNormalized();
    turn.angle = std::atan2(a.cross(b).norm(), a.dot(b));
    if (unit_cross(a, b, turn.axis)) return turn;
    turn.angle = a.dot(b) > 0.0 ? 0.0 : pi;
    if (unit_cross(segment, tip, turn.axis)) {
        turn.axis = (turn.axis - turn.axis.dot(a) * a)
                        .normalized(); // up to rounding, already perpendicular to `from`
        return turn;
    }
    if (unit_cross(a, noise, turn.axis)) return turn;
    int least;
    a.cwiseAbs().minCoeff(&least);
    turn.axis = a.cross(Vec3d::Unit(least)).normalized();
    return turn;
}

Vec3d turned(const Vec3d& v, const Vec3d& axis, double angle) { // Rodrigues' formula
    return v * std::cos(angle) + axis.cross(v) * std::sin(angle) +
           axis * (axis.dot(v) * (1.0 - std::cos(angle)));
}

} // namespace marram::oracle
