// SPDX-License-Identifier: Apache-2.0
// The closest point on a triangle is the projection onto its plane if that is inside (its barycentric
// coordinates are cross products with the edges), else it is on one of the three edges, each a clamped
// projection.
#include "procedural/wind/collision/near.h"

#include "core/math/nearest_point.h"
#include "procedural/wind/collision/shortest.h"

#include <algorithm>
#include <limits>

namespace marram {
namespace {

MARRAM_INLINE VDouble squared_to_edge(const Wide3d& a, const Wide3d& b, const Wide3d& p) {
    const Wide3d e = b - a, d = p - a;
    const VDouble ee = dot(e, e);
    const VDouble t = vmin(vmax(dot(d, e) / select(ee > 0.0, ee, 1.0), VDouble{}), 1.0);
    const Wide3d r = d - e * t;
    return dot(r, r);
}

MARRAM_INLINE VDouble squared_distance(const Triangles8& t, const Wide3d& p) {
    const Wide3d &a = t.corner[0], &b = t.corner[1], &c = t.corner[2];
    const Wide3d ab = b - a, ac = c - a, ap = p - a;
    const Wide3d n = cross(ab, ac);
    const VDouble nn = dot(n, n), h = dot(ap, n);
    const VDouble v = dot(cross(ap, ac), n), w = dot(cross(ab, ap), n);
    const VLong inside = (v >= 0.0) & (w >= 0.0) & (v + w <= nn) & (nn > 0.0);
    const VDouble edges =
        vmin(squared_to_edge(a, b, p), vmin(squared_to_edge(b, c, p), squared_to_edge(c, a, p)));
    return select(inside, vmin(h * h / select(nn > 0.0, nn, 1.0), edges), edges);
}

MARRAM_HOT void min_squared(std::span<const Triangles8> triangles, const Vec3d& p, VDouble& least) {
    const Wide3d q = splat3(p.data());
    for (const Triangles8& t : triangles) least = vmin(least, squared_distance(t, q));
}

// The segment crosses if its ends are on different sides and it has the same orientation about all three
// edges.
MARRAM_HOT void crossed(std::span<const Triangles8> triangles, const Vec3d& p, const Vec3d& q,
                        VLong& any_crossed) {
    const Wide3d from = splat3(p.data()), to = splat3(q.data()), d = to - from;
    for (const Triangles8& t : triangles) {
        const Wide3d a = t.corner[0] - from, b = t.corner[1] - from, c = t.corner[2] - from;
        const VDouble u = dot(cross(c, b), d), v = dot(cross(a, c), d), w = dot(cross(b, a), d);
        const VLong around = ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        const Wide3d n = cross(b - a, c - a);
        const VDouble h0 = dot(a, n), h1 = h0 - dot(d, n); // height of the plane above the two ends
        any_crossed |=
            around & (((h0 >= 0.0) & (h1 <= 0.0)) | ((h0 <= 0.0) & (h1 >= 0.0))) & (dot(n, n) > 0.0);
    }
}

struct Bulge {
    const Vec3d &p, &q, &b0, &b1;
    double distance;
};

MARRAM_HOT void near_bulge(const Triangles8& t, const Bulge& bulge, VLong& near) {
    const Shortest shortest = shortest_vector(splat3(bulge.p.data()), splat3(bulge.q.data()), t);
    const VDouble length = vsqrt(shortest.squared);
    const VDouble zero{};
    const VDouble push = vmax(dot(shortest.v, splat3(bulge.b0.data())), zero) +
                         vmax(dot(shortest.v, splat3(bulge.b1.data())), zero);
    near = length * length - push < length * (bulge.distance * (1.0 + 1e-12));
}

} // namespace

MARRAM_HOT void squared_distances(const TriangleCluster& cluster, const Vec3d& from, const Vec3d& facing,
                                  Squared8& out) {
    Triangles8 triangles;
    load(cluster, from, triangles);
    // Normals from the original corners: their differences are exact.
    const Wide3d a = to_double(cluster.corner[0]), e0 = to_double(cluster.corner[1]) - a,
                 e1 = to_double(cluster.corner[2]) - a;
    const VDouble towards = dot(cross(e0, e1), splat3(facing.data()));
    const VDouble rounding = 1e-14 * vsqrt(dot(e0, e0) * dot(e1, e1));
    const VLong any_side = VLong{} - int64_t(facing.isZero(0.0));
    const VDouble squared = squared_distance(triangles, Wide3d{});
    out.squared = select((towards >= -rounding) | any_side, squared, std::numeric_limits<double>::infinity());
    out.sure = (towards > rounding) | any_side;
}

NearestTriangle nearest_triangle(const Colliders& colliders, const Vec3d& q, double radius) {
    NearestTriangle nearest;
    double limit = radius;
    colliders.tree->nearest(colliders.lent, q, radius, [&](const NearCluster& near) {
        const MarramMesh& mesh = colliders.lent[near.mesh];
        Squared8 distances;
        squared_distances(*near.cluster, q, Vec3d::Zero(), distances);
        for (uint32_t lane = 0; lane < near.count; ++lane) {
            const double wide = limit * (1.0 + 1e-9);
            if (!(distances.squared[int(lane)] <= wide * wide)) continue;
            const uint32_t triangle = near.cluster->triangle[lane];
            const Vec3d point = nearest_point(colliders.corners(mesh, triangle), q);
            const double distance = (point - q).norm();
            const bool tie = nearest.mesh && distance == nearest.distance &&
                             std::pair(mesh.geometry_id, triangle) <
                                 std::pair(nearest.mesh->geometry_id, nearest.triangle);
            if (distance > limit || (nearest.mesh && distance >= nearest.distance && !tie)) continue;
            nearest = {&mesh, triangle, distance, point};
            limit = distance;
        }
        return limit;
    });
    return nearest;
}

void keep_near_bulge(std::span<const Triangles8> triangles, size_t count, const Vec3d& p, const Vec3d& q,
                     const Vec3d& bulge0, const Vec3d& bulge1, double distance, TriangleList& kept) {
    kept.clear();
    for (size_t i = 0; i < triangles.size(); ++i) {
        VLong near;
        near_bulge(triangles[i], {p, q, bulge0, bulge1, distance}, near);
        for (size_t lane = 0; lane < lanes && i * lanes + lane < count; ++lane)
            if (near[lane]) kept.push(triangles[i], int(lane));
    }
}

double nearest_distance(std::span<const Triangles8> triangles, const Vec3d& p) {
    VDouble least = splat(std::numeric_limits<double>::infinity());
    min_squared(triangles, p, least);
    double result = least[0];
    for (int i = 1; i < lanes; ++i) result = std::min(result, double(least[i]));
    return std::sqrt(result);
}

bool crosses_any(std::span<const Triangles8> triangles, const Vec3d& p, const Vec3d& q) {
    VLong any_crossed{};
    crossed(triangles, p, q, any_crossed);
    return any(any_crossed);
}

} // namespace marram
