// SPDX-License-Identifier: Apache-2.0
// Heights above the skin that a strand grows on, and raising a CV to a fraction of its height at rest.
#pragma once

#include "procedural/wind/collision/colliders.h"

namespace marram {

// A point above (height > 0) or below (height < 0) the skin.
struct SkinPoint {
    Vec3d point, normal; // the closest point on the skin, and its triangle's normal
    double height;       // signed by the normal
    uint32_t triangle;
};

inline constexpr uint32_t no_triangle = ~0U;

// The closest point to p on those triangles of `skin` within `reach` that face the same way as `facing` (the
// dot product of their normals is positive). Without this test a strand in an ear would measure from the
// other side of the ear. `hint`: a triangle that is probably close; the result does not depend on it. False:
// there is none. `facing` 0: all triangles that have an area.
bool closest_skin_point(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p,
                        const Vec3d& facing, double reach, uint32_t hint, SkinPoint& closest);

// Call this if something is near the path from `rest` to p. Raises p along the skin's normal below `rest`
// until its height is at least 0.98 x `scale` times that of `rest`, whose closest point defines the side of
// the skin. At most four steps; if the normals below the two differ by more than a right angle, p may end
// lower. The result is continuous in p as long as the closest point on that side does not jump. `facing`: the
// normal at the root. `hint`: see closest_skin_point(); it becomes the triangle below `rest`. False: there is
// no consistent side; p is unchanged.
bool raise_to_min_height(const Colliders& colliders, const MarramMesh& skin, const Vec3d& rest,
                         const Vec3d& facing, double reach, double scale, uint32_t& hint, Vec3d& p);

} // namespace marram
