// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/collision/rendered_segment.h"

#include "procedural/wind/collision/near.h"

namespace marram {
namespace {

struct PenetrationCheck {
    const Colliders& colliders;
    const RenderedSegment& segment;
    double allowed, room; // distance to the polygon plus radius up to which no test is needed: room
    double tolerance;
    TurnScratch& scratch;
};

// Marches along the curve from t = begin to end past the triangles in scratch.kept, which are relative to
// `centre`. If a point has d more than the required distance from all of them, the next d of the curve are
// skipped. The minimum step is a fifth of the tolerance (at least 1/4096 in t), because the curve is tested
// against nine tenths of it.
bool follow(const PenetrationCheck& check, double begin, double end, const Vec3d& centre) {
    const RenderedSegment& segment = check.segment;
    const std::span<const Triangles8> triangles = check.scratch.kept.blocks();
    // Maximum speed for t in [0, 1]: of the segment, plus offset(t), whose slope is at most |D| / 2.
    const double speed =
        (segment.end - segment.start).norm() + 4.0 * segment.max_offset() + std::abs(segment.r1 - segment.r0);
    const double shortest = std::max(0.2 * check.tolerance / speed, 1.0 / 4096.0);
    for (double t = begin;; t = std::min(t, end)) {
        const Vec3d away = segment.offset(t), from = segment.on_polygon(t) - centre;
        const double distance = away.norm(), radius = segment.radius(t);
        double open = check.room - distance - radius;
        if (open < 0.0) {
            const bool inside = crosses_any(triangles, from, from + away);
            const double nearest = nearest_distance(triangles, from + away);
            // Penetrates by more than the tolerance: inside by that minus the radius, or outside but closer
            // than radius - tolerance.
            const double must = radius - check.allowed;
            if (inside ? nearest > -must : nearest < must) return true;
            open = inside ? 0.0 : nearest - std::max(must, 0.0);
        }
        if (t >= end) return false;
        t += std::max(shortest, open / speed);
    }
}

// Tests a part of the curve. It is clear if nothing is near, or if all triangles are on the side away from
// its offset; otherwise the curve is followed. A part with many triangles around it is split in four.
bool part_penetrates(const PenetrationCheck& check, double begin, double end, int cuts) {
    const RenderedSegment& segment = check.segment;
    const Vec2d most = segment.offset_bounds(begin, end);
    const Vec3d b0 = segment.d0 * most[0], b1 = segment.d1 * most[1];
    const double widest = std::max(segment.r0, segment.r1);
    if (b0.norm() + b1.norm() + widest <= check.room) return false;
    const Vec3d centre = segment.on_polygon(0.5 * (begin + end));
    const double distance = std::max(widest - check.allowed, 0.0);
    SearchRegion region(distance);
    for (const double t : {begin, end}) {
        const Vec3d p = segment.on_polygon(t);
        for (const Vec3d& away : {Vec3d(Vec3d::Zero()), b0, b1, Vec3d(b0 + b1)}) region.add(p + away);
    }
    constexpr size_t many = 16; // clusters
    constexpr int max_cuts = 4, pieces = 4;
    if (!triangles_near(check.colliders, region, centre, cuts < max_cuts ? many : SIZE_MAX, check.scratch)) {
        for (int i = 0; i < pieces; ++i)
            if (part_penetrates(check, begin + (end - begin) * i / pieces,
                                begin + (end - begin) * (i + 1) / pieces, cuts + 1))
                return true;
        return false;
    }
    if (check.scratch.triangles.size() == 0) return false;
    const std::span<Triangles8> all = check.scratch.triangles.blocks();
    keep_near_bulge(all, check.scratch.triangles.size(), segment.on_polygon(begin) - centre,
                    segment.on_polygon(end) - centre, b0, b1, distance, check.scratch.kept);
    return check.scratch.kept.size() > 0 && follow(check, begin, end, centre);
}

} // namespace

bool penetrates_collider(const Colliders& colliders, const RenderedSegment& segment, double free_distance,
                         double tolerance, TurnScratch& scratch) {
    const double allowed = 0.9 * tolerance, room = allowed + free_distance;
    if (segment.max_offset() + std::max(segment.r0, segment.r1) <= room) return false;
    const PenetrationCheck check{colliders, segment, allowed, room, tolerance, scratch};
    return part_penetrates(check, 0.0, 0.5, 0) || part_penetrates(check, 0.5, 1.0, 0);
}

} // namespace marram
