// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/colliders.h"

#include <algorithm>

namespace marram {

Colliders colliders_at(const MarramFrame& frame, uint32_t time_index) {
    Colliders colliders;
    if (!frame.colliders || frame.mesh_count == 0) return colliders;
    colliders.scene = frame.colliders;
    colliders.time_index = time_index;
    colliders.time = frame.time_count > 1 ? float(time_index) / float(frame.time_count - 1) : 0.0F;
    for (uint32_t i = 0; i < frame.mesh_count; ++i) {
        const MarramMesh& mesh = frame.meshes[i];
        if (mesh.geometry_id >= colliders.meshes.size())
            colliders.meshes.resize(mesh.geometry_id + 1, nullptr);
        colliders.meshes[mesh.geometry_id] = &mesh;
    }
    return colliders;
}

void make_trees(const MarramFrame& frame, const Eigen::AlignedBox3d& reach,
                std::span<Colliders* const> colliders) {
    const bool moving = std::any_of(frame.meshes, frame.meshes + frame.mesh_count,
                                    [](const MarramMesh& mesh) { return mesh.time_count > 1; });
    const ColliderTree* first = nullptr;
    for (Colliders* one : colliders) {
        if (!one->any()) continue;
        if (first && !moving)
            one->tree = colliders.front()->tree;
        else
            one->tree = std::make_shared<ColliderTree>(frame, reach, one->time_index, first);
        first = colliders.front()->tree.get();
    }
}

namespace {

Vec3d nearest_on_edge(const Vec3d& a, const Vec3d& b, const Vec3d& q) {
    const Vec3d e = b - a;
    const double ee = e.squaredNorm();
    return ee > 0.0 ? Vec3d(a + e * std::clamp((q - a).dot(e) / ee, 0.0, 1.0)) : a;
}

} // namespace

Vec3d nearest_point(const std::array<Vec3d, 3>& p, const Vec3d& q) {
    const Vec3d ab = p[1] - p[0], ac = p[2] - p[0], n = ab.cross(ac);
    const double nn = n.squaredNorm();
    const double longest = std::max({ab.squaredNorm(), ac.squaredNorm(), (p[2] - p[1]).squaredNorm()});
    constexpr double rounding = 1e-14;
    if (nn > rounding * rounding * longest * longest) {
        const Vec3d aq = q - p[0];
        const double v = aq.cross(ac).dot(n), w = ab.cross(aq).dot(n); // barycentrics times nn
        if (v >= 0.0 && w >= 0.0 && v + w <= nn) return q - n * (aq.dot(n) / nn);
    }
    Vec3d best = p[0];
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < 3; ++i) {
        const Vec3d c = nearest_on_edge(p[i], p[(i + 1) % 3], q);
        const double d = (c - q).squaredNorm();
        if (d >= least) continue;
        least = d;
        best = c;
    }
    return best;
}

} // namespace marram
