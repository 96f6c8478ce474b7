// SPDX-License-Identifier: Apache-2.0
// The nearest point of a triangle lies inside, where the foot of the perpendicular does (its barycentric coordinates are
// those of the cross products with the edges), or on one of the three edges, each a clamped projection.
#include "procedural/wind/near.h"

namespace marram {
namespace {

MARRAM_INLINE VDouble squared_to_edge(const Wide3d& a, const Wide3d& b, const Wide3d& p) {
    const Wide3d e = b - a, d = p - a;
    const VDouble ee = dot(e, e);
    const VDouble t = vmin(vmax(dot(d, e) / (ee > 0.0 ? ee : splat(1.0)), VDouble{}), splat(1.0));
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
    return inside ? vmin(h * h / (nn > 0.0 ? nn : splat(1.0)), edges) : edges;
}

MARRAM_HOT void least_squared(std::span<const Triangles8> triangles, const Vec3d& p, VDouble& least) {
    const Wide3d q = splat3(p.data());
    for (const Triangles8& t : triangles) least = vmin(least, squared_distance(t, q));
}

// The segment passes through where its ends lie on different sides and it turns the same way about all three edges.
MARRAM_HOT void crossed(std::span<const Triangles8> triangles, const Vec3d& p, const Vec3d& q,
                        VLong& any_crossed) {
    const Wide3d from = splat3(p.data()), to = splat3(q.data()), d = to - from;
    for (const Triangles8& t : triangles) {
        const Wide3d a = t.corner[0] - from, b = t.corner[1] - from, c = t.corner[2] - from;
        const VDouble u = dot(cross(c, b), d), v = dot(cross(a, c), d), w = dot(cross(b, a), d);
        const VLong around = ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        const Wide3d n = cross(b - a, c - a);
        const VDouble h0 = dot(a, n), h1 = h0 - dot(d, n); // of the plane over the two ends
        any_crossed |=
            around & (((h0 >= 0.0) & (h1 <= 0.0)) | ((h0 <= 0.0) & (h1 >= 0.0))) & (dot(n, n) > 0.0);
    }
}

// The shortest of some vectors, kept as they come.
struct alignas(64) Shortest {
    Wide3d v{};
    VDouble squared = splat(std::numeric_limits<double>::infinity());
    MARRAM_INLINE void take(const Wide3d& r) {
        const VDouble rr = dot(r, r);
        const VLong shorter = rr < squared;
        v = select(shorter, r, v);
        squared = shorter ? rr : squared;
    }
};

MARRAM_INLINE Wide3d to_edge(const Wide3d& a, const Wide3d& b, const Wide3d& p) {
    const Wide3d e = b - a, d = p - a;
    const VDouble ee = dot(e, e);
    const VDouble t = vmin(vmax(dot(d, e) / (ee > 0.0 ? ee : splat(1.0)), VDouble{}), splat(1.0));
    return e * t - d;
}

// From a point to the inside of a triangle, along its normal; far away where the foot is outside.
MARRAM_INLINE Wide3d to_face(const Triangles8& t, const Wide3d& p) {
    const Wide3d ab = t.corner[1] - t.corner[0], ac = t.corner[2] - t.corner[0], ap = p - t.corner[0];
    const Wide3d n = cross(ab, ac);
    const VDouble nn = dot(n, n), v = dot(cross(ap, ac), n), w = dot(cross(ab, ap), n);
    const VLong inside = (v >= 0.0) & (w >= 0.0) & (v + w <= nn) & (nn > 0.0);
    const VDouble far = splat(1e300) / vmax(dot(ap, ap), splat(1.0));
    const VDouble s = -dot(ap, n) / (nn > 0.0 ? nn : splat(1.0));
    return select(inside, n * s, Wide3d{far, far, far} * splat(1e-200));
}

// Between two segments, from the first to the second (Ericson, 5.1.9): clamped on one, then on the other.
MARRAM_INLINE Wide3d between(const Wide3d& p, const Wide3d& d, const Wide3d& a, const Wide3d& b) {
    const Wide3d e = b - a, r = p - a;
    const VDouble dd = dot(d, d), ee = dot(e, e), de = dot(d, e), dr = dot(d, r), er = dot(e, r);
    const VDouble zero{}, one = splat(1.0), slant = dd * ee - de * de;
    const VLong skew = slant > 1e-14 * dd * ee;
    VDouble s = skew ? (de * er - dr * ee) / (skew ? slant : one) : zero;
    s = vmin(vmax(s, zero), one);
    VDouble t = (de * s + er) / (ee > 0.0 ? ee : one);
    t = vmin(vmax(t, zero), one);
    s = (de * t - dr) / (dd > 0.0 ? dd : one);
    s = vmin(vmax(s, zero), one);
    return (e * t - r) - d * s;
}

struct Bulge {
    const Vec3d &p, &q, &b0, &b1;
    double distance;
};

MARRAM_HOT void near_bulge(const Triangles8& t, const Bulge& bulge, VLong& near) {
    const Wide3d p = splat3(bulge.p.data()), q = splat3(bulge.q.data()), d = q - p;
    Shortest shortest;
    shortest.take(to_face(t, p));
    shortest.take(to_face(t, q));
    for (int i = 0; i < 3; ++i) {
        const Wide3d &a = t.corner[i], &b = t.corner[(i + 1) % 3];
        shortest.take(between(p, d, a, b));
        shortest.take(to_edge(a, b, p)); // where the segments are parallel
        shortest.take(to_edge(a, b, q));
    }
    const VDouble length = vsqrt(shortest.squared);
    const VDouble push = vmax(
        vmax(dot(shortest.v, splat3(bulge.b0.data())), dot(shortest.v, splat3(bulge.b1.data()))), VDouble{});
    near = length * length - push < length * (bulge.distance * (1.0 + 1e-12));
}

} // namespace

MARRAM_HOT void facing_distances(const Triangles8& triangles, const Vec3d& facing, Squared8& out) {
    const Wide3d n =
        cross(triangles.corner[1] - triangles.corner[0], triangles.corner[2] - triangles.corner[0]);
    const VDouble squared = squared_distance(triangles, Wide3d{});
    out.squared =
        dot(n, splat3(facing.data())) > 0.0 ? squared : splat(std::numeric_limits<double>::infinity());
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
    least_squared(triangles, p, least);
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
