// SPDX-License-Identifier: Apache-2.0
// Curve wind as the talk defines it: at the start of each segment, from the root on, all later points are
// rotated, one by one.
//
// At P_k of the partly bent curve, Q rotates P_tip - P_k onto w + noise_k; its angle is scaled by f_k.
// O(n^2). f_k = clamp(global_rotate * ramp_rotate(u_k) * e_k, 0, 1), u_k = s_k / L of the rest curve. If
// reference_segments is given, f_k is replaced by 1 - (1 - f_k)^(reference_segments span_k / L), with span_k
// the length from the middle of segment k - 1 to that of segment k, or |segment k| if `own_spans` is set.
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
    double reference_segments = 0.0; // 0: f_k unchanged, exactly the talk
    bool own_spans = false;          // segments of unequal length, with no other reference than their number
};

// The factor of each of the n - 1 segments.
std::vector<double> bend_factors(const std::vector<Vec3d>& rest, const Bend& bend);
// The bent CVs. Error: rounding, about 1e-16 of the length per rotation.
std::vector<Vec3d> bend_curve(std::vector<Vec3d> cvs, const Bend& bend);

} // namespace marram::oracle
