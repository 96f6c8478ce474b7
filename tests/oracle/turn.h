// SPDX-License-Identifier: Apache-2.0
// The shortest rotation from one direction to another, with a rule for opposite directions.
#pragma once

#include "core/math/vec.h"

namespace marram::oracle {

struct Turn {
    double angle = 0.0;          // 0 to pi
    Vec3d axis = Vec3d::UnitX(); // unit
};

// The rotation from `from` to `to`. If they are opposite (sine of the angle below 1e-14, where a cross
// product of unit vectors is only rounding), the axis follows chain.md's rule: segment x tip, which rotates
// the segment towards the tip, where `segment` is the direction of the segment at the pivot and `tip` the one
// from pivot to tip; else tip x noise; else tip x the coordinate axis of its smallest component. If either
// vector is zero, there is no rotation.
Turn shortest_turn(const Vec3d& from, const Vec3d& to, const Vec3d& segment, const Vec3d& tip,
                   const Vec3d& noise);

Vec3d turned(const Vec3d& v, const Vec3d& axis, double angle);

} // namespace marram::oracle
