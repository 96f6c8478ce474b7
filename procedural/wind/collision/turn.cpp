// SPDX-License-Identifier: Apache-2.0
// Exact contact: rotates a segment about its start towards its goal until it touches a triangle. The sector
// that it sweeps is a convex region; the collider tree finds the triangles that may be in it. If there are
// many, the sector is halved and the first half is tested first; parts beyond a contact are never tested.
// Triangles entirely on one side of the plane of the turn are skipped; the rest go to first_blocked(). The
// result is a minimum over triangles, so it does not depend on how the sector was divided.
#include "procedural/wind/collision/turn.h"

#include "core/math/nearest_point.h"
#include "procedural/abi/values.h"
#include "procedural/wind/collision/near.h"

#include <algorithm>
#include <array>

namespace marram {
namespace {

constexpr size_t max_clusters = 64; // a sector with more is halved
constexpr int max_halvings = 12;    // halvings of a sector
constexpr int push_out_steps = 32;  // steps of half a turn in the search for a free direction
constexpr double opposed_sine =
    1e-9; // from and goal count as opposed if the sine between them is smaller: the strand beyond picks the plane

struct Part { // of a sector, in angles
    double begin, end;
    int cuts;
};

// Corners of a polygon around the arc, in pieces of at most a sixth of a full turn.
SearchRegion sector(const Vec3d& pivot, const TurningCapsule& capsule, const Part& part, double radius) {
    SearchRegion region(radius);
    region.add(pivot);
    region.limit_to_slab(capsule.normal);
    const int pieces = std::max(int(std::ceil((part.end - part.begin) * (3.0 / pi))), 1);
    const double half = 0.5 * (part.end - part.begin) / pieces, beyond = capsule.length / std::cos(half);
    const auto add = [&](double angle, double distance) {
        region.add(pivot + capsule.direction(std::cos(angle), std::sin(angle)) * distance);
    };
    add(part.begin, capsule.length);
    for (int i = 0; i < pieces; ++i) add(part.begin + (2 * i + 1) * half, beyond);
    add(part.end, capsule.length);
    return region;
}

// A cluster relative to the origin. `meets`: triangles not entirely on one side of the plane through the
// origin.
MARRAM_HOT void load_at_plane(const TriangleCluster& cluster, const Vec3d& origin, const Vec3d& normal,
                              double radius, Triangles8& triangles, VLong& meets) {
    load(cluster, origin, triangles);
    const Wide3d n = splat3(normal.data());
    const VDouble a = dot(triangles.corner[0], n), b = dot(triangles.corner[1], n),
                  c = dot(triangles.corner[2], n);
    meets = (vmin(a, vmin(b, c)) <= radius) & (vmax(a, vmax(b, c)) >= -radius);
}

// Triangles of the region's clusters, relative to the pivot, without those on one side of the region's plane.
// False: there are more than `most` clusters.
bool gather(const Colliders& colliders, const SearchRegion& region, size_t most, TurnScratch& scratch) {
    scratch.triangles.clear();
    if (!colliders.tree->find(colliders.lent, region, most, scratch.clusters)) return false;
    for (const NearCluster& near : scratch.clusters) {
        Triangles8 eight;
        VLong meets;
        load_at_plane(*near.cluster, region.points()[0], region.normal(), region.radius(), eight, meets);
        for (uint32_t lane = 0; lane < near.count; ++lane)
            if (meets[int(lane)]) scratch.triangles.push(eight, int(lane));
    }
    return true;
}

// Search radius: the clearance, plus a margin for rounding.
double search_radius(double clearance, double length) { return clearance * (1.0 + 1e-12) + length * 1e-12; }

struct Sweep {
    bool blocked_at_start, not_clear;
    double first; // angle of the first contact; infinity: none
    Vec2d at;     // its cosine and sine
};

constexpr double pivot_check_factor = 1.1; // an unverified pivot must be free by this many clearances

Sweep sweep(const Colliders& colliders, const Segment& segment, const Arc& arc, TurnScratch& scratch) {
    Sweep result{false, false, std::numeric_limits<double>::infinity(), Vec2d::Zero()};
    const double reach = search_radius(arc.capsule.clearance, segment.length);
    double end = diamond_of_angle(arc.angle); // in diamond units (contact.h), as FirstBlocked::turn
    Part parts[max_halvings + 1];
    int top = 0;
    parts[top++] = {0.0, arc.angle, 0};
    while (top > 0) {
        const Part part = parts[--top];
        if (part.begin > result.first) break;
        const bool clearance_unverified = segment.clearance_unverified && part.begin == 0.0;
        const SearchRegion region = sector(segment.pivot, arc.capsule, part,
                                           clearance_unverified ? pivot_check_factor * reach : reach);
        if (!gather(colliders, region, part.cuts < max_halvings ? max_clusters : SIZE_MAX, scratch)) {
            const double middle = 0.5 * (part.begin + part.end);
            parts[top++] = {middle, part.end, part.cuts + 1};
            parts[top++] = {part.begin, middle, part.cuts + 1};
            continue;
        }
        if (scratch.triangles.size() == 0) continue;
        if (clearance_unverified &&
            !clear_of_pivot(scratch.triangles.blocks(), segment.clearance * pivot_check_factor)) {
            result.not_clear = true;
            return result;
        }
        if (first_blocked(arc.capsule, end, scratch.triangles, scratch.first)) {
            end = scratch.first.turn;
            if (end < 0.0) {
                result.blocked_at_start = true;
                return result;
            }
            result.at = from_diamond(end);
            result.first = std::max(std::atan2(result.at.y(), result.at.x()), 0.0);
        }
    }
    return result;
}

void set_ray(RTCRay& ray, const Colliders& colliders, const Vec3d& from, const Vec3d& direction,
             double length) {
    ray.org_x = float(from.x());
    ray.org_y = float(from.y());
    ray.org_z = float(from.z());
    ray.dir_x = float(direction.x());
    ray.dir_y = float(direction.y());
    ray.dir_z = float(direction.z());
    ray.tnear = 0.0F;
    ray.tfar = float(length);
    ray.time = colliders.time;
    ray.mask = MARRAM_COLLIDES;
    ray.id = 0;
    ray.flags = 0;
}

RTCRayHit trace(const Colliders& colliders, const Segment& segment, const Vec3d& direction) {
    RTCRayHit hit;
    set_ray(hit.ray, colliders, segment.pivot, direction, segment.length);
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(colliders.scene, &hit, 0);
    return hit;
}

// True: a ray hits a triangle that crosses the segment.
bool ray_confirms_blocked(const Colliders& colliders, const Segment& segment, TurnScratch& scratch) {
    // Beyond there is no mesh, and Embree rejects such rays.
    if (!(segment.pivot.cwiseAbs().maxCoeff() < embree_limit)) return false;
    const RTCRayHit found = trace(colliders, segment, segment.from);
    const MarramMesh* mesh = colliders.mesh_of(found.hit);
    if (!mesh) return false;
    const auto p = colliders.corners(*mesh, found.hit.primID);
    scratch.triangles.clear();
    scratch.triangles.push(p[0] - segment.pivot, p[1] - segment.pivot, p[2] - segment.pivot);
    return crosses_any(scratch.triangles.blocks(), Vec3d::Zero(), segment.from * segment.length);
}

// If angle 0 is blocked: the exact angle at which the blocked interval ends, if before `end`; else infinity.
double blocked_interval_end(const Colliders& colliders, const Vec3d& pivot, const TurningCapsule& capsule,
                            double end, TurnScratch& scratch) {
    gather(colliders, sector(pivot, capsule, {0.0, end, 0}, search_radius(capsule.clearance, capsule.length)),
           SIZE_MAX, scratch);
    const double last = diamond_of_angle(end);
    std::vector<Blocked>& blocked = scratch.blocked;
    blocked.clear();
    blocked_turns(capsule, 0.0, last, scratch.triangles.blocks(), scratch.triangles.size(), blocked);
    std::sort(blocked.begin(), blocked.end(),
              [](const Blocked& a, const Blocked& b) { return a.low < b.low; });
    double up = 0.0; // diamond units, as Blocked
    for (const Blocked& b : blocked) {
        if (b.low > up) break;
        up = std::max(up, b.high);
    }
    if (up >= last) return std::numeric_limits<double>::infinity();
    const Vec2d at = from_diamond(up);
    return std::atan2(at.y(), at.x());
}

Vec2d out_step(int i) { // cosine and sine of step i
    static const auto table = [] {
        std::array<Vec2d, 2 * push_out_steps + 1> t;
        for (size_t k = 0; k < t.size(); ++k)
            t[k] = {std::cos(pi / push_out_steps * double(k)), std::sin(pi / push_out_steps * double(k))};
        return t;
    }();
    return table[size_t(i)];
}

// Turns out of a collider within one plane, to the side that needs the smaller turn. Rays at equal steps find
// the blocked range without clearance. From two steps beyond the last blocked one, or from `most`, the
// segment turns back until contact. Returns the angle turned; more than pi: the plane has no free direction
// within `most`.
double turn_out_in_plane(const Colliders& colliders, const Segment& segment, const TurningCapsule& capsule,
                         double most, TurnScratch& scratch, Vec3d& direction) {
    constexpr double step = pi / push_out_steps;
    constexpr double none = 2.0 * pi;
    int blocked[2] = {0, 0};
    double least = none;
    for (;;) {
        const int side = blocked[0] <= blocked[1] ? 0 : 1;
        const double sign = side == 0 ? 1.0 : -1.0, from = blocked[side] * step;
        if (from >= std::min({least, most, pi})) return least;
        const Vec2d next = out_step(blocked[side] + 1);
        if (ray_meets(colliders, segment.pivot, capsule.direction(next.x(), sign * next.y()),
                      segment.length)) {
            ++blocked[side];
            continue;
        }
        // Two steps further the segment is usually free, and the way back is short: finding the contact needs
        // far fewer triangles than finding the end of the blocked interval.
        const auto at = [&](double turn) { return capsule.direction(std::cos(turn), sign * std::sin(turn)); };
        const double free = std::min(from + 2.0 * step, most);
        const bool last = free == most; // must itself be free; otherwise no free direction is closer
        if (last && ray_meets(colliders, segment.pivot, at(free), segment.length)) {
            blocked[side] = 2 * push_out_steps;
            continue;
        }
        Arc back{capsule, free - from};
        back.capsule.from = at(free).normalized();
        back.capsule.normal = capsule.normal * -sign;
        back.capsule.across = back.capsule.normal.cross(back.capsule.from);
        const Sweep found = sweep(colliders, segment, back, scratch);
        double turned = free - found.first;
        if (found.blocked_at_start && last) {
            turned = none;
        } else if (found.blocked_at_start) {
            TurningCapsule remaining = capsule;
            remaining.from = at(from).normalized();
            remaining.normal = capsule.normal * sign;
            remaining.across = remaining.normal.cross(remaining.from);
            turned = from + blocked_interval_end(colliders, segment.pivot, remaining, free - from, scratch);
        } else if (found.first > back.angle) {
            turned = from; // due to rounding: `from` was blocked
        }
        if (turned < least) {
            least = turned;
            direction = at(turned);
            scratch.contact_triangle.clear();
            if (!found.blocked_at_start && found.first <= back.angle) {
                const auto& p = scratch.first.corner;
                scratch.contact_triangle.push(p[0], p[1], p[2]);
            }
        }
        blocked[side] = turned <= pi || last ? 2 * push_out_steps : blocked[side] + 2;
    }
}

// Straight out: the plane of `from` and the direction from the closest point to the pivot, which is outside.
// If the goal is close to `from`, the plane of the arc is almost arbitrary. A push-out in it alone makes
// strands curl sideways and jump from frame to frame.
bool plane_straight_out(const Colliders& colliders, const Segment& segment, TurningCapsule& capsule) {
    const NearestTriangle nearest = nearest_triangle(colliders, segment.pivot, segment.length);
    if (!nearest.mesh) return false;
    const Vec3d away = segment.pivot - nearest.point;
    const Vec3d across = away - segment.from * away.dot(segment.from);
    if (!(across.squaredNorm() > 1e-12 * away.squaredNorm())) return false;
    capsule.across = across.normalized();
    capsule.normal = capsule.from.cross(capsule.across).normalized();
    return true;
}

// Tries planes rotated about `from` away from the plane of the arc, smallest rotation first.
bool turn_out(const Colliders& colliders, const Segment& segment, const Arc& arc, int planes,
              TurnScratch& scratch, Vec3d& direction) {
    for (int i = 0; i < planes; ++i) {
        const double turn = pi / double(planes) * double(i % 2 == 0 ? -(i / 2) : (i + 1) / 2);
        TurningCapsule capsule = arc.capsule;
        capsule.clearance = segment.clearance;
        capsule.across = arc.capsule.across * std::cos(turn) + arc.capsule.normal * std::sin(turn);
        capsule.normal = capsule.from.cross(capsule.across);
        double least = 2.0 * pi;
        if (i == 0) {
            TurningCapsule straight = capsule;
            if (plane_straight_out(colliders, segment, straight))
                least = turn_out_in_plane(colliders, segment, straight, pi, scratch, direction);
        }
        Vec3d other;
        const double turned =
            turn_out_in_plane(colliders, segment, capsule, std::min(least, pi), scratch, other);
        if (turned < least)
            direction = other;
        else if (least > pi)
            continue;
        return true;
    }
    return false;
}

double free_length(const Colliders& colliders, const Segment& segment, const Vec3d& direction) {
    return double(trace(colliders, segment, direction).ray.tfar);
}

// No direction is free: the one whose ray gets farthest before it hits a triangle.
Vec3d longest_free_direction(const Colliders& colliders, const Segment& segment, const Arc& arc) {
    constexpr int planes = 16, turns = 16;
    Vec3d best = segment.from;
    double longest = free_length(colliders, segment, best);
    for (int i = 0; i < planes; ++i)
        for (int j = 1; j < 2 * turns; ++j) {
            const double plane = pi * i / planes, turn = pi * (j - turns) / turns;
            const Vec3d across = arc.capsule.across * std::cos(plane) + arc.capsule.normal * std::sin(plane);
            const Vec3d direction = segment.from * std::cos(turn) + across * std::sin(turn);
            const double length = free_length(colliders, segment, direction);
            if (length <= longest) continue;
            longest = length;
            best = direction;
        }
    return best;
}

// A cluster relative to the origin. `near`: triangles that neither their own plane nor their box separates
// from the region.
MARRAM_HOT void load_near(const TriangleCluster& cluster, const Vec3d& origin, const SearchRegion& region,
                          Triangles8& triangles, VLong& near) {
    load(cluster, origin, triangles);
    const Wide3d &a = triangles.corner[0], &b = triangles.corner[1], &c = triangles.corner[2];
    const Wide3d n = cross(b - a, c - a);
    const VDouble r = splat(region.radius()), height = dot(n, a), far = r * vsqrt(dot(n, n));
    VDouble below = splat(std::numeric_limits<double>::infinity()), above = -below;
    Vec3d least = Vec3d::Constant(below[0]), most = -least;
    for (const Vec3d& q : region.points()) {
        least = least.cwiseMin(q);
        most = most.cwiseMax(q);
        const VDouble h = dot(n, splat3(q.data())) - height;
        below = vmin(below, h);
        above = vmax(above, h);
    }
    const auto aside = [&](VDouble p, VDouble q, VDouble s, double low, double high) MARRAM_ALWAYS_INLINE {
        return (vmin(p, vmin(q, s)) - high > r) | (low - vmax(p, vmax(q, s)) > r);
    };
    near = ~((vmax(below, -above) > far) | aside(a.x, b.x, c.x, least.x(), most.x()) |
             aside(a.y, b.y, c.y, least.y(), most.y()) | aside(a.z, b.z, c.z, least.z(), most.z()));
}

// Calls visit(eight, lane) for the triangles that may be near the region, relative to `origin`, until it
// returns false.
template <typename Visit>
void each_near(const SearchRegion& region, const std::vector<NearCluster>& clusters, const Vec3d& origin,
               Visit&& visit) {
    SearchRegion moved(region.radius());
    for (const Vec3d& q : region.points()) moved.add(q - origin);
    for (const NearCluster& cluster : clusters) {
        Triangles8 eight;
        VLong near;
        load_near(*cluster.cluster, origin, moved, eight, near);
        for (uint32_t lane = 0; lane < cluster.count; ++lane)
            if (near[int(lane)] && !visit(eight, int(lane))) return;
    }
}

} // namespace

bool region_is_clear(const Colliders& colliders, const SearchRegion& region, TurnScratch& scratch) {
    // On a fine skin many clusters are near if any is: the first few usually decide.
    constexpr size_t few_clusters = 8;
    for (const size_t most : {few_clusters, max_clusters}) {
        const bool all = colliders.tree->find(colliders.lent, region, most, scratch.clusters);
        bool clear = true;
        each_near(region, scratch.clusters, region.points()[0],
                  [&](const Triangles8&, int) { return clear = false; });
        if (!clear || all) return clear;
    }
    return false;
}

bool triangles_near(const Colliders& colliders, const SearchRegion& region, const Vec3d& origin, size_t most,
                    TurnScratch& scratch) {
    scratch.triangles.clear();
    if (!colliders.tree->find(colliders.lent, region, most, scratch.clusters)) return false;
    each_near(region, scratch.clusters, origin, [&](const Triangles8& eight, int lane) {
        scratch.triangles.push(eight, lane);
        return true;
    });
    return true;
}

bool any_triangle_within(const Colliders& colliders, const Vec3d& centre, double radius,
                         TurnScratch& scratch) {
    SearchRegion ball(radius);
    ball.add(centre);
    colliders.tree->find(colliders.lent, ball, SIZE_MAX, scratch.clusters);
    bool found = false;
    each_near(ball, scratch.clusters, centre, [&](const Triangles8& eight, int lane) {
        const auto corner = [&](size_t k) {
            return Vec3d(eight.corner[k].x[lane], eight.corner[k].y[lane], eight.corner[k].z[lane]);
        };
        found =
            nearest_point({corner(0), corner(1), corner(2)}, Vec3d::Zero()).squaredNorm() <= radius * radius;
        return !found;
    });
    return found;
}

Arc arc_of(const Segment& segment) {
    const Vec3d &a = segment.from, &g = segment.goal;
    const double cosine = a.dot(g);
    Vec3d axis = a.cross(g);
    double sine = axis.norm();
    if (sine <= opposed_sine && !(cosine > 0.0 && sine > 0.0)) {
        // Opposed or equal: use the plane of the strand's lean.
        axis = a.cross(segment.lean);
        if (!(axis.squaredNorm() > 1e-12 * segment.lean.squaredNorm())) {
            Eigen::Index least;
            a.cwiseAbs().minCoeff(&least);
            axis = a.cross(Vec3d::Unit(least));
        }
        sine = 0.0;
    }
    // For nearly equal directions the cross product is only good to 1e-16 / sine: orthogonalise again.
    const Vec3d across = axis.normalized().cross(a).normalized();
    const Vec3d normal = a.cross(across).normalized();
    return {{a, across, normal, segment.length, segment.clearance}, std::atan2(sine, cosine)};
}

Turned turn_exactly(const Colliders& colliders, const Segment& given, TurnScratch& scratch) {
    Segment segment = given;
    Arc arc = arc_of(segment);
    Sweep found{true, false, 0.0, Vec2d::Zero()};
    if (!segment.test_ray_first || !ray_confirms_blocked(colliders, segment, scratch))
        found = sweep(colliders, segment, arc, scratch);
    // The pivot may be too close: the coarse tests (planes, boxes) say so, or the sweep was blocked at angle
    // 0 and ended before it had tested all triangles near the pivot. Measure the clearance exactly.
    if (found.not_clear || (found.blocked_at_start && segment.clearance_unverified)) {
        if (any_triangle_within(colliders, segment.pivot, segment.clearance * pivot_check_factor, scratch))
            return {segment.from, Outcome::not_clear, false, 0.0};
        segment.clearance_unverified = false;
        found = sweep(colliders, segment, arc, scratch);
    }
    const double goal_angle = arc.angle;
    const bool pushed_out = found.blocked_at_start;
    if (pushed_out) {
        constexpr int planes = 16, more_planes = 64;
        const double least = 1e-6 * segment.length;
        Vec3d out;
        bool is_out = turn_out(colliders, segment, arc, planes, scratch, out);
        while (!is_out && segment.clearance > least) {
            segment.clearance = std::max(0.25 * segment.clearance, 0.99 * least);
            is_out = turn_out(colliders, segment, arc, segment.clearance > least ? planes : more_planes,
                              scratch, out);
        }
        if (!is_out)
            return {longest_free_direction(colliders, segment, arc),
                    Outcome::unresolved,
                    true,
                    0.0,
                    goal_angle,
                    0.0};
        // Continue towards the goal. It is exactly at its clearance, so go on with a little less.
        segment.from = out.normalized();
        segment.clearance *= 1.0 - 1e-6;
        // Usually it touches the collider in front of the goal again at once: it stays if the triangle that
        // stopped it blocks it within 1e-6 rad.
        arc = arc_of(segment);
        constexpr double at_once = 0.05, stays = 1e-6;
        found = {false, false, std::numeric_limits<double>::infinity(), Vec2d::Zero()};
        double most = std::min(arc.angle, at_once);
        if (scratch.contact_triangle.size() > 0 &&
            first_blocked(arc.capsule, diamond_of_angle(most), scratch.contact_triangle, scratch.first))
            found.blocked_at_start = scratch.first.turn < stays;
        if (!found.blocked_at_start) {
            Arc near = arc;
            near.angle = most;
            found = sweep(colliders, segment, near, scratch);
            if (!found.blocked_at_start && found.first > near.angle && near.angle < arc.angle)
                found = sweep(colliders, segment, arc, scratch);
        }
        if (found.blocked_at_start)
            return {segment.from,      Outcome::contact, true,
                    segment.clearance, goal_angle,       goal_angle - arc.angle};
    }
    if (found.first > arc.angle)
        return {segment.goal, Outcome::arrived, pushed_out, segment.clearance, goal_angle, goal_angle};
    return {arc.capsule.direction(found.at.x(), found.at.y()).normalized(),
            Outcome::contact,
            pushed_out,
            segment.clearance,
            goal_angle,
            goal_angle - arc.angle + found.first};
}

bool ray_meets(const Colliders& colliders, const Vec3d& from, const Vec3d& direction, double length) {
    RTCRay ray;
    set_ray(ray, colliders, from, direction, length);
    marram_occluded1(colliders.scene, &ray);
    return ray.tfar < 0.0F;
}

Turned turn_by_steps(const Colliders& colliders, const Segment& segment, int steps) {
    const Arc arc = arc_of(segment);
    const auto at = [&](double turn) { return arc.capsule.direction(std::cos(turn), std::sin(turn)); };
    const auto blocked = [&](const Vec3d& direction) {
        return ray_meets(colliders, segment.pivot, direction, segment.length);
    };
    if (blocked(segment.from)) {
        for (int i = 1; i <= steps; ++i)
            for (const double side : {1.0, -1.0}) {
                const double turn = side * arc.angle * i / steps;
                if (!blocked(at(turn)))
                    return {at(turn), Outcome::contact, true,
                            0.0,      arc.angle,        arc.angle - std::abs(arc.angle - turn)};
            }
        return {segment.from, Outcome::unresolved, true, 0.0, arc.angle, 0.0};
    }
    Vec3d last = segment.from;
    for (int i = 1; i <= steps; ++i) {
        const Vec3d next = i == steps ? segment.goal : at(arc.angle * i / steps);
        if (blocked(next))
            return {last, Outcome::contact, false, 0.0, arc.angle, arc.angle * (i - 1) / steps};
        last = next;
    }
    return {segment.goal, Outcome::arrived, false, 0.0, arc.angle, arc.angle};
}

} // namespace marram
