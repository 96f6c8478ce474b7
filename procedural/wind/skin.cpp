// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/skin.h"

namespace marram {

bool foot_of(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p, const Vec3d& facing,
             double reach, Foot& foot) {
    bool found = false;
    double best = reach;
    uint32_t best_triangle = 0;
    near_triangles(colliders, p, reach, [&](const MarramMesh& mesh, uint32_t triangle, double limit) {
        if (&mesh != &skin) return limit;
        const auto corners = colliders.corners(mesh, triangle);
        const Vec3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if (!(n.dot(facing) > 0.0)) return limit;
        const Vec3d point = nearest_point(corners, p);
        const double distance = (p - point).norm();
        if (distance > best || (found && distance == best && triangle > best_triangle)) return limit;
        const Vec3d normal = n.normalized();
        // Above an edge or a vertex both neighbours are equally near; which is taken does not matter for the height.
        foot = {point, normal, std::copysign(distance, (p - point).dot(normal))};
        found = true;
        best = distance;
        best_triangle = triangle;
        return best;
    });
    return found;
}

bool push_out(const Colliders& colliders, const MarramMesh& skin, const Vec3d& rest, const Vec3d& facing,
              double reach, double scale, Vec3d& p) {
    Foot at_rest, now;
    if (!foot_of(colliders, skin, rest, facing, reach, at_rest)) return false;
    if (!foot_of(colliders, skin, p, at_rest.normal, reach, now)) return false;
    const double wanted = scale * at_rest.height;
    if (now.height < wanted) p += now.normal * (wanted - now.height);
    return true;
}

} // namespace marram
