// SPDX-License-Identifier: Apache-2.0
// Shielding: one ray for each CV, from `offset` upwind of it towards it; a triangle on the way shields it.
//
// The ray is the segment from P - w offset to P - w offset margin: its last part is left out, so that the
// skin in which a windward root stands does not count. A decision that a small error could turn, because the
// ray passes within 1e-6 offset of a triangle's edge or one of its ends that near to a triangle, is marked as
// grazing; inner edges of a closed mesh mark rays too, although nothing hangs on them here. `wake` and
// `spread` are not covered.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

struct Shielding {
    std::vector<bool> hit, grazing; // of each CV
    double alpha = 0.0;             // hits / n
};

constexpr double shield_grazing = 1e-6; // of the offset (accuracy.md)

Shielding shield_curve(const std::vector<Vec3d>& cvs, const Vec3d& wind, double offset, double margin,
                       const TriangleSet& set);
// env_shield = clamp(1 - shield alpha, 0, 1)
double shield_envelope(double shield, double alpha);

} // namespace marram::oracle
