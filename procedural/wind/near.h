// SPDX-License-Identifier: Apache-2.0
// Distances and crossings of a handful of triangles, eight at a time.
#pragma once

#include "procedural/wind/colliders.h"
#include "procedural/wind/contact.h"

namespace marram {

// Distance of the point from the nearest of the triangles, in their coordinates; infinite where there are none. Error: 1e-15
// of the distances from the origin; a triangle without area counts as its edges.
double nearest_distance(std::span<const Triangles8> triangles, const Vec3d& p);

// The triangles of a cluster relative to `origin`; spare lanes repeat the last. To be called from hot functions only: what it does
// takes many times as long in baseline code.
MARRAM_INLINE void load(const TriangleCluster& cluster, const Vec3d& origin, Triangles8& out) {
    const Wide3d o = splat3(origin.data());
    for (int k = 0; k < 3; ++k) out.corner[k] = to_double(cluster.corner[k]) - o;
}

// The squares of the distances of a cluster's triangles from `from`; infinite for those that face away from `facing`, unless
// that is 0. `sure`: not those that face to the side, within rounding: they have a distance, and the caller decides.
struct alignas(64) Squared8 {
    VDouble squared;
    VLong sure;
};
void squared_distances(const TriangleCluster& triangles, const Vec3d& from, const Vec3d& facing,
                       Squared8& out);

struct NearestTriangle {
    const MarramMesh* mesh = nullptr; // nullptr: none within the radius
    uint32_t triangle = 0;
    double distance = 0.0;
    Vec3d point = Vec3d::Zero(); // on it
};

// The nearest triangle of the colliders' tree; of several as near the first by geometry and number.
NearestTriangle nearest_triangle(const Colliders& colliders, const Vec3d& q, double radius);

// Whether the segment from p to q passes through a triangle. In double, not exact: within rounding of an edge either answer
// may come.
bool crosses_any(std::span<const Triangles8> triangles, const Vec3d& p, const Vec3d& q);

// The line from p to q is drawn as a curve that leaves it by x bulge0 + y bulge1 with x and y between 0 and 1. Keeps of the
// triangles those that it may come nearer to than `distance`; `kept` is cleared first. A triangle and the segment are parted by
// the plane across their shortest connection n, so the curve is no nearer than that less what the bulges go along n.
void keep_near_bulge(std::span<const Triangles8> triangles, size_t count, const Vec3d& p, const Vec3d& q,
                     const Vec3d& bulge0, const Vec3d& bulge1, double distance, TriangleList& kept);

} // namespace marram
