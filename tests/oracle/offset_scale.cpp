// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/offset_scale.h"

namespace marram::oracle {

SkinPoint closest_on_skin(const Vec3d& p, const Vec3d& facing, const TriangleSet& skin) {
    auto normal_of = [&](int i) {
        return Vec3d(area_normal(skin.triangles()[size_t(i)]).stableNormalized());
    };
    const Nearest nearest =
        skin.nearest(p, p, TriangleSet::no_limit, [&](int i) { return normal_of(i).dot(facing) > 0.0; });
    SkinPoint closest;
    if (nearest.triangle < 0) return closest;
    closest.found = true;
    closest.point = nearest.closest.on_triangle;
    closest.normal = normal_of(nearest.triangle);
    // Tolerance for equally close: some thousands of roundings of the distance and a few of the coordinates.
    const double rounding = 1e-12 * nearest.closest.distance +
                            4.0 * std::numeric_limits<double>::epsilon() * p.cwiseAbs().maxCoeff();
    double most = -1.0;
    int sharing = 0;
    for (int i : skin.within(p, p, nearest.closest.distance + rounding)) {
        const Vec3d normal = normal_of(i);
        if (!(normal.dot(facing) > 0.0)) continue;
        ++sharing;
        const double height = std::abs(normal.dot(p - closest.point));
        if (height > most) most = height, closest.normal = normal;
    }
    closest.on_edge = sharing > 1;
    closest.height = std::copysign(nearest.closest.distance, closest.normal.dot(p - closest.point));
    return closest;
}

Pushed push_targets(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& bent, const Vec3d& root_normal,
                    double offset_scale, const TriangleSet& skin) {
    Pushed result;
    result.cvs = bent;
    result.push.assign(bent.size(), 0.0);
    result.on_edge.assign(bent.size(), false);
    for (size_t k = 1; k < bent.size(); ++k) {
        const SkinPoint below_rest = closest_on_skin(rest[k], root_normal, skin);
        const SkinPoint below_bent =
            below_rest.found ? closest_on_skin(bent[k], below_rest.normal, skin) : SkinPoint{};
        if (!below_bent.found) {
            ++result.skipped;
            continue;
        }
        result.on_edge[k] = below_rest.on_edge || below_bent.on_edge;
        const double wanted = offset_scale * below_rest.height;
        double height = below_bent.height;
        for (int step = 0; step < 4 && height < wanted * (step == 0 ? 1.0 : 0.98); ++step) {
            result.push[k] += wanted - height;
            result.cvs[k] = bent[k] + result.push[k] * below_rest.normal;
            const SkinPoint below = closest_on_skin(result.cvs[k], below_rest.normal, skin);
            if (!below.found) break;
            result.on_edge[k] = result.on_edge[k] || below.on_edge;
            height = below.height;
        }
    }
    return result;
}

} // namespace marram::oracle
