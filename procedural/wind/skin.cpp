// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/skin.h"

namespace marram {

bool foot_of(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p, const Vec3d& facing,
             double reach, Foot& foot) {
    bool found = false;
    double best = reach, most_along = 0.0;
    uint32_t best_triangle = 0;
    near_triangles(colliders, p, reach, [&](const MarramMesh& mesh, uint32_t triangle, double limit) {
        if (&mesh != &skin) return limit;
        const auto corners = colliders.corners(mesh, triangle);
        const Vec3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if (!(n.dot(facing) > 0.0)) return limit;
        const Vec3d point = nearest_point(corners, p), normal = n.normalized();
        const double distance = (p - point).norm(), along = (p - point).dot(normal);
        // Above an edge or a corner several triangles are equally near, to rounding; the one that sees p most from its front
        // or back knows the side: beside a ridge the other's plane may pass on the wrong side of p.
        const double tie = 1e-12 * (distance + point.cwiseAbs().maxCoeff() * 1e-3);
        if (distance > best + tie) return limit;
        const bool nearer = distance < best - tie;
        if (found && !nearer &&
            std::pair(std::abs(along), -double(triangle)) <= std::pair(most_along, -double(best_triangle)))
            return limit;
        foot = {point, normal, std::copysign(distance, along)};
        found = true;
        best = std::min(best, distance);
        most_along = std::abs(along);
        best_triangle = triangle;
        return best + tie;
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
