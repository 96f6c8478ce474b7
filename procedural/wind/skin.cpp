// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/skin.h"

#include "procedural/wind/near.h"

namespace marram {

bool foot_of(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p, const Vec3d& facing,
             double reach, uint32_t hint, Foot& foot) {
    bool found = false;
    double best = reach, most_along = 0.0, tie = 0.0;
    const auto consider = [&](uint32_t triangle) {
        const auto corners = colliders.corners(skin, triangle);
        const Vec3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if (!(n.dot(facing) > 0.0)) return;
        const Vec3d point = nearest_point(corners, p), normal = n.normalized();
        const double distance = (p - point).norm(), along = (p - point).dot(normal);
        // Above an edge or a corner several triangles are equally near, to rounding; the one that sees p most from its front
        // or back knows the side: beside a ridge the other's plane may pass on the wrong side of p.
        tie = 1e-12 * (distance + point.cwiseAbs().maxCoeff() * 1e-3);
        if (distance > best + tie) return;
        const bool nearer = distance < best - tie;
        if (found && !nearer &&
            std::pair(std::abs(along), -double(triangle)) <= std::pair(most_along, -double(foot.triangle)))
            return;
        foot = {point, normal, std::copysign(distance, along), triangle};
        found = true;
        best = std::min(best, distance);
        most_along = std::abs(along);
    };
    if (hint != no_triangle) consider(hint);
    colliders.tree->nearest(colliders.lent, p, best + tie, [&](const NearCluster& found_near) {
        if (&colliders.lent[found_near.mesh] != &skin) return best + tie;
        const uint32_t* triangle = found_near.cluster->triangle;
        const size_t count = found_near.count;
        Squared8 distances;
        squared_distances(*found_near.cluster, p, facing, distances);
        // The nearest of them first: the rest can then only be as near.
        size_t first = 0;
        for (size_t lane = 1; lane < count; ++lane)
            if (distances.squared[lane] < distances.squared[first]) first = lane;
        const auto near = [&](size_t lane) {
            const double limit = (best + tie) * (1.0 + 1e-9) + 1e-9 * tie;
            return distances.squared[lane] <= limit * limit;
        };
        if (!near(first)) return best + tie;
        consider(triangle[first]);
        for (size_t lane = 0; lane < count; ++lane)
            if (lane != first && near(lane)) consider(triangle[lane]);
        return best + tie;
    });
    return found;
}

bool push_out(const Colliders& colliders, const MarramMesh& skin, const Vec3d& rest, const Vec3d& facing,
              double reach, double scale, uint32_t& hint, Vec3d& p) {
    Foot at_rest, now;
    if (!foot_of(colliders, skin, rest, facing, reach, hint, at_rest)) return false;
    hint = at_rest.triangle;
    if (!foot_of(colliders, skin, p, at_rest.normal, reach, hint, now)) return false;
    // Along the normal at rest, which does not change from frame to frame: by the normal below p the target would jump where p
    // comes from one triangle's side to the next's. A step gains its length where the two normals agree, less where they do not.
    constexpr int steps = 4;
    constexpr double enough = 0.98;
    const double wanted = scale * at_rest.height;
    for (int i = 0; i < steps && now.height < (i > 0 ? enough * wanted : wanted); ++i) {
        p += at_rest.normal * (wanted - now.height);
        if (i + 1 < steps && !foot_of(colliders, skin, p, at_rest.normal, reach, now.triangle, now)) break;
    }
    return true;
}

} // namespace marram
