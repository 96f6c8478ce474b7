// SPDX-License-Identifier: Apache-2.0
// Distances from and intersections with a few triangles, eight at a time.
#pragma once

#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/collision/contact.h"

namespace marram {

// Distance from p to the closest of the triangles, in their coordinates; infinite if there are none. Error:
// 1e-15 of the distances from the origin. A triangle without area counts as its edges.
double nearest_distance(std::span<const Triangles8> triangles, const Vec3d& p);

// The triangles of a cluster relative to `origin`; unused lanes repeat the last. Call it from MARRAM_HOT
// functions only: in baseline code it takes many times as long.
MARRAM_INLINE void load(const TriangleCluster& cluster, const Vec3d& origin, Triangles8& out) {
    const Wide3d o = splat3(origin.data());
    for (int k = 0; k < 3; ++k) out.corner[k] = to_double(cluster.corner[k]) - o;
}

// Squared distances from `from` to a cluster's triangles; infinite for triangles that face away from
// `facing`, unless that is 0. `sure` is false for those edge-on to `facing` within rounding: they have a
// distance, and the caller decides.
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
    Vec3d point = Vec3d::Zero(); // closest point on it
};

// The closest triangle in the collider tree; of equally close ones the first by geometry ID and index.
NearestTriangle nearest_triangle(const Colliders& colliders, const Vec3d& q, double radius);

// True: the segment from p to q passes through a triangle. Computed in double, not exact: within rounding of
// an edge either result is possible.
bool crosses_any(std::span<const Triangles8> triangles, const Vec3d& p, const Vec3d& q);

// The line from p to q is rendered as a curve offset from it by x bulge0 + y bulge1, with x and y between 0
// and 1. Keeps the triangles that the curve may be closer to than `distance`; `kept` is cleared first. The
// plane perpendicular to the shortest connection n of a triangle and the segment separates them. So the curve
// is no closer than |n| minus the extent of the bulges along n.
void keep_near_bulge(std::span<const Triangles8> triangles, size_t count, const Vec3d& p, const Vec3d& q,
                     const Vec3d& bulge0, const Vec3d& bulge1, double distance, TriangleList& kept);

} // namespace marram
