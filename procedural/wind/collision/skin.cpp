// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/collision/skin.h"

#include "core/math/nearest_point.h"
#include "procedural/wind/collision/near.h"

#include <algorithm>

namespace marram {

bool closest_skin_point(const Colliders& colliders, const MarramMesh& skin, const Vec3d& p,
                        const Vec3d& facing, double reach, uint32_t hint, SkinPoint& closest) {
    const bool any_facing = facing == Vec3d::Zero();
    bool found = false;
    double best = reach, most_along = 0.0, tie = 0.0;
    const auto consider = [&](uint32_t triangle) {
        const auto corners = colliders.corners(skin, triangle);
        const Vec3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if (!(any_facing ? n.squaredNorm() > 0.0 : n.dot(facing) > 0.0)) return;
        const Vec3d point = nearest_point(corners, p), normal = n.normalized();
        const double distance = (p - point).norm(), along = (p - point).dot(normal);
        // Beyond an edge or a corner several triangles are equally close, to rounding. The one with p
        // farthest from its plane defines the side: at a ridge the plane of the other may pass on the wrong
        // side of p.
        tie = 1e-12 * (distance + point.cwiseAbs().maxCoeff() * 1e-3);
        if (distance > best + tie) return;
        const bool nearer = distance < best - tie;
        if (found && !nearer &&
            std::pair(std::abs(along), -double(triangle)) <= std::pair(most_along, -double(closest.triangle)))
            return;
        closest = {point, normal, std::copysign(distance, along), triangle};
        found = true;
        best = std::min(best, distance);
        most_along = std::abs(along);
    };
    if (hint != no_triangle) consider(hint);
    // Distances, eight at a time, bound the minimum; only triangles within the final bound are tested
    // exactly.
    struct Candidate {
        uint32_t triangle;
        double squared;
    } candidates[64];
    size_t count = 0;
    double bound = best;
    const double rounding_margin = 1e-12 * (reach + (p.cwiseAbs().maxCoeff() + reach) * 1e-3);
    const auto limit = [&] {
        const double far = (bound + rounding_margin) * (1.0 + 1e-9);
        return far * far;
    };
    const auto drop_far = [&] {
        const auto* end = std::remove_if(candidates, candidates + count,
                                         [&](const Candidate& c) { return c.squared > limit(); });
        count = size_t(end - candidates);
    };
    colliders.tree->nearest(colliders.lent, p, bound + rounding_margin, [&](const NearCluster& near) {
        if (&colliders.lent[near.mesh] != &skin) return bound + rounding_margin;
        Squared8 distances;
        squared_distances(*near.cluster, p, facing, distances);
        double least = bound * bound;
        for (uint32_t lane = 0; lane < near.count; ++lane)
            if (distances.sure[int(lane)]) least = std::min(least, double(distances.squared[int(lane)]));
        bound = std::min(bound, std::sqrt(least));
        for (uint32_t lane = 0; lane < near.count; ++lane) {
            const double squared = distances.squared[int(lane)];
            if (squared > limit()) continue;
            if (count == std::size(candidates)) drop_far();
            if (count == std::size(candidates)) { // so many at equal distance: test it now
                consider(near.cluster->triangle[lane]);
                continue;
            }
            candidates[count++] = {near.cluster->triangle[lane], squared};
        }
        return bound + rounding_margin;
    });
    drop_far();
    for (size_t i = 0; i < count; ++i) consider(candidates[i].triangle);
    return found;
}

bool raise_to_min_height(const Colliders& colliders, const MarramMesh& skin, const Vec3d& rest,
                         const Vec3d& facing, double reach, double scale, uint32_t& hint, Vec3d& p) {
    SkinPoint at_rest, now;
    if (!closest_skin_point(colliders, skin, rest, facing, reach, hint, at_rest)) return false;
    hint = at_rest.triangle;
    if (!closest_skin_point(colliders, skin, p, at_rest.normal, reach, hint, now)) return false;
    // Raise along the normal at rest, which does not change from frame to frame. With the normal below p the
    // target would jump where p passes from one triangle to the next. A step gains its full length if the two
    // normals agree, otherwise less.
    constexpr int steps = 4;
    constexpr double enough = 0.98;
    const double wanted = scale * at_rest.height;
    for (int i = 0; i < steps && now.height < (i > 0 ? enough * wanted : wanted); ++i) {
        p += at_rest.normal * (wanted - now.height);
        if (i + 1 < steps &&
            !closest_skin_point(colliders, skin, p, at_rest.normal, reach, now.triangle, now))
            break;
    }
    return true;
}

} // namespace marram
