// SPDX-License-Identifier: Apache-2.0
// Shielding: one ray per CV, from `offset` upwind of it towards it. A triangle that the ray hits shields the
// CV.
//
// The ray is the segment from P - w offset to P - w offset margin. Its last part is left out, so that a
// windward root is not shielded by its own skin. A result that a small error could change is marked as
// grazing: the ray passes within 1e-6 offset of a triangle's edge, or one of its ends is that close to a
// triangle. Inner edges of a closed mesh mark rays too, although the result does not depend on them.
//
// wake: a triangle at the distance d upwind shields by 1 - d / fade, and not at all if d > fade; of several
// the nearest counts. spread: the mean over all directions d within that angle of the upwind direction -w,
// weighted by solid angle. Directions from below the skin (d . normal < 0) are excluded if they are also
// lower than the wind's own direction (d . normal < -w . normal). If none is left, the wind's own direction
// is used.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

struct Shielding {
    std::vector<bool> hit, grazing; // per CV
    double alpha = 0.0;             // hits / n
};

constexpr double shield_grazing = 1e-6; // of the offset (accuracy.md)

Shielding shield_curve(const std::vector<Vec3d>& cvs, const Vec3d& wind, double offset, double margin,
                       const TriangleSet& set);

// The distance at which the shelter of a triangle's object has faded out, m; absent: it does not fade.
using Fade = std::function<double(int triangle)>;

struct Shelter {
    double value = 0.0; // 0 ... 1
    bool grazing = false;
};
// Shelter from the direction `from` (unit, upwind), at distances from `offset` margin to `offset`.
Shelter shelter_from(const Vec3d& p, const Vec3d& from, double offset, double margin, const TriangleSet& set,
                     const Fade& fade = {});
// The mean over the cone from n points of the Hammersley set (height on the cap (i + 1/2) / n, azimuth by the
// radical inverse of i in base 2). Error about n^-3/4 if an edge runs through the cone.
double cone_shelter(const Vec3d& p, const Vec3d& normal, const Vec3d& wind, double spread, int n,
                    double offset, double margin, const TriangleSet& set, const Fade& fade = {});

// env_shield = clamp(1 - shield alpha, 0, 1)
double shield_envelope(double shield, double alpha);

} // namespace marram::oracle
