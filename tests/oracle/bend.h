// SPDX-License-Identifier: Apache-2.0
// Curve wind as the talk words it: at every segment's start, from the root on, all points beyond are turned,
// one by one.
//
// At P_k, with the curve as bent so far: Q turns P_tip - P_k onto w + noise_k; its angle is scaled by f_k.
// O(n^2). f_k = clamp(global_rotate * ramp_rotate(u_k) * e_k, 0, 1), u_k = s_k / L of the rest curve; with
// reference_segments given, 1 - (1 - f_k)^(reference_segments |segment k| / L) in its place.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"

#include <vector>

namespace marram::oracle {

struct Bend {
    Vec3d wind = Vec3d::UnitX();  // w, unit
    std::vector<Vec3d> noise;     // dir_noise of every segment, amplitude included; empty: none
    std::vector<double> envelope; // e_k of every CV; empty: 1
    double global_rotate = 1.0;
    Ramp ramp_rotate;
    double reference_segments = 0.0; // 0: f_k as it is, exactly the talk
};

// The factor of each of the n - 1 segments.
std::vector<double> bend_factors(const std::vector<Vec3d>& rest, const Bend& bend);
// The bent CVs. Error: rounding, some 1e-16 of the length a turn.
std::vector<Vec3d> bend_curve(std::vector<Vec3d> cvs, const Bend& bend);

} // namespace marram::oracle
