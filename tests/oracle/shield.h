// SPDX-License-Identifier: Apache-2.0
// Shielding: one ray for each CV, from `offset` upwind of it towards it; a triangle on the way shields it.
//
// The ray is the segment from P - w offset to P - w offset margin: its last part is left out, so that the
// skin in which a windward root stands does not count. A decision that a small error could turn, because the
// ray passes within 1e-6 offset of a triangle's edge or one of its ends that near to a triangle, is marked as
// grazing; inner edges of a closed mesh mark rays too, although nothing hangs on them here.
//
// wake: what shelters from a distance d behind it shelters by 1 - d / fade, nothing where d > fade; of several the
// nearest counts. spread: the mean over all directions within that angle of the wind's origin, equal solid angles
// counting equally, without those from below the skin (d . normal < 0) unless the wind itself comes from lower still
// (d . normal < -w . normal); where that leaves none, the wind's own direction.
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

// The distance at which the shelter of what a triangle belongs to has faded out; absent: it does not fade.
using Fade = std::function<double(int triangle)>;

struct Shelter {
    double value = 0.0; // 0 ... 1
    bool grazing = false;
};
// From direction `from` (unit, upwind), as far as `offset`, without the first `offset` margin.
Shelter shelter_from(const Vec3d& p, const Vec3d& from, double offset, double margin, const TriangleSet& set,
                     const Fade& fade = {});
// The mean over the cone by n points of Hammersley's set (height on the cap i + 1/2 over n, turn the radical inverse of i
// in base 2); off by about n^-3/4 where an edge runs through the cone.
double cone_shelter(const Vec3d& p, const Vec3d& normal, const Vec3d& wind, double spread, int n,
                    double offset, double margin, const TriangleSet& set, const Fade& fade = {});

// env_shield = clamp(1 - shield alpha, 0, 1)
double shield_envelope(double shield, double alpha);

} // namespace marram::oracle
