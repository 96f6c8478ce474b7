// SPDX-License-Identifier: Apache-2.0
// Heights above the skin that a strand grows on, and the push that keeps a share of them.
#pragma once

#include "procedural/wind/colliders.h"

namespace marram {

// A place above (or, with a negative height, below) the skin.
struct SkinPoint {
    Vec3d point, normal; // the nearest point of the skin, and its triangle's normal
    double height;       // signed by the normal
    uint32_t triangle;
};

inline constexpr uint32_t no_triangle = ~0U;

// The closest point to p among triangles of `skin` that face the same way as `facing` (their normals' product is
// positive), within `reach`; a strand that stands in an ear would else measure from the ear's other side. `hint`: a triangle
// that is probably near; the result does not depend on it. False: none there. `facing` 0: all triangles that have an area.
bool closest_skin_point(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p,
                        const Vec3d& facing, double reach, uint32_t hint, SkinPoint& closest);

// To be asked where something is near the way from `rest` to p. Moves p out along the skin's normal below `rest` until it stands at
// least 0.98 x `scale` times as high as `rest` (four steps; where normals below the two differ by more than a right angle, lower),
// whose closest point gives the side of the skin. Moves on smoothly where p does and the nearest point of that side does not jump.
// `facing`: the normal at the root. `hint`: see closest_skin_point(); it becomes the triangle below `rest`. False: there is no consistent
// side; p stays.
bool push_out(const Colliders& colliders, const MarramMesh& skin, const Vec3d& rest, const Vec3d& facing,
              double reach, double scale, uint32_t& hint, Vec3d& p);

} // namespace marram
