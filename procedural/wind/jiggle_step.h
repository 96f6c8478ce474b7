// SPDX-License-Identifier: Apache-2.0
// One step of the damped oscillator whose target moves along a cubic. See jiggle_step.cpp for the derivation.
#pragma once

#include "core/math/simd.h"

#include <array>
#include <span>

namespace marram {

// Over a step, the target moves along the cubic through two samples whose slopes are those of the neighbours
// (Catmull-Rom). D0, D1, D2: its changes from the sample before to the first, from the first to the second,
// and from there to the next. Lag e and velocity w (metres a radian):
//
//     e' = c e + s w - f[0] D0 - f[1] D1 - f[2] D2
//     w' = -s e + d w + g[0] D0 + g[1] D1 + g[2] D2
//
// Real: double, or VDouble for eight.
template <typename Real>
struct JiggleStep {
    Real c, s, d;
    std::array<Real, 3> f, g;
};

// Coefficients for the first `share` (0 ... 1) of the way between two samples; the part lasts `radians` =
// omega h >= 0. Error < 4e-15 (1 + radians max(1, 2 damping)), as if the argument were rounded. Radians beyond
// 2^30 / max(1, 2 damping) count as that.
JiggleStep<double> jiggle_step(double damping, double radians, double share = 1.0);

// out[level]: the coefficients for 2^level times `radians`.
void jiggle_steps(double damping, double radians, std::span<JiggleStep<double>> out);
void jiggle_steps(double damping, const VDouble& radians, std::span<JiggleStep<VDouble>> out);
JiggleStep<VDouble> jiggle_step(double damping, const VDouble& radians, double share);

// Upper bound on the error of the filtered position if all targets more than `radians` in the past are off by
// at most 1. Exact for damping >= 1, otherwise at most pi / 2 times too large; decreases with `radians`.
// Infinite for damping 0.
double jiggle_tail(double damping, double radians);

} // namespace marram
