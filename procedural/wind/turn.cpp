// SPDX-License-Identifier: Apache-2.0
// The sector that a segment sweeps is covered by cells, pieces between two radii and two turns. A cell asks for the triangles
// in its bounding sphere; where there are more than `few` it is cut in two, across its longer side, so that open air is
// cleared by one query and only what is close to a surface is looked at closely. A contact that has been found shortens the
// turn, and cells beyond it are never asked. Triangles that stay on one side of the plane of the turn are left out at
// once; the rest go to blocked_turns(). The result is a minimum over triangles, so it does not depend on the cells.
#include "procedural/wind/turn.h"

#include <algorithm>

namespace marram {
namespace {

constexpr int root_halvings = 2;   // of a root's segment, where the skin is dense
constexpr int crowded_memory = 16; // sweeps for which a dense skin is remembered
constexpr int pieces = 4;          // that a thin wedge is cut into
constexpr size_t few = 96;         // triangles a cell may hold before it is cut
constexpr int deepest = 40;        // cuts of cells
constexpr int out_steps = 32;      // of half a turn, at which a free direction is looked for
constexpr double opposed =
    1e-9; // sine to exact opposition below which the arc's plane is taken from elsewhere

double sqr(double x) { return x * x; }

struct Cell {
    double near, far, begin, end; // radii, angles
    int depth;
};

// The smallest sphere, nearly, around a cell: its centre lies on the bisector. c, s: of half the cell's angle, below half a
// turn; the centre's distance from the pivot is returned.
double bounding_sphere(const Cell& cell, double c, double s, double& radius) {
    const double x = std::min(0.5 * (cell.near + cell.far) / c, cell.far * c);
    const double corner2 = sqr(cell.far * c - x) + sqr(cell.far * s),
                 inner2 = sqr(cell.near * c - x) + sqr(cell.near * s);
    radius = std::max({std::sqrt(std::max(corner2, inner2)), cell.far - x, x - cell.near});
    return x;
}

void bounding_sphere(const Cell& cell, const Turning& turning, Vec3d& centre, double& radius) {
    const double half = 0.5 * (cell.end - cell.begin), middle = 0.5 * (cell.begin + cell.end);
    if (half >= 0.499 * pi) {
        centre = Vec3d::Zero();
        radius = cell.far;
        return;
    }
    const double x = bounding_sphere(cell, std::cos(half), std::sin(half), radius);
    centre = turning.direction(std::cos(middle), std::sin(middle)) * x;
}

// The numbers of the triangles near a ball; false: there are more than `most`. Their corners come later: on a large mesh they
// are far apart in memory, and so all are on their way before the first is needed.
bool find_near(const Colliders& colliders, const Vec3d& centre, double radius, size_t most,
               TurnScratch& scratch) {
    scratch.triangles.clear();
    scratch.found.clear();
    bool whole = true;
    ++scratch.queries;
    near_triangles(colliders, centre, radius, [&](const MarramMesh& mesh, uint32_t triangle, double limit) {
        if (scratch.found.size() >= most) {
            whole = false;
            return -1.0;
        }
        __builtin_prefetch(mesh.triangles + 3 * size_t(triangle));
        scratch.found.push_back({&mesh, triangle});
        return limit;
    });
    scratch.visited += scratch.found.size();
    if (!whole) return false;
    for (const FoundTriangle& found : scratch.found)
        for (size_t i = 0; i < 3; ++i) __builtin_prefetch(colliders.corner(*found.mesh, found.triangle, i));
    return true;
}

// Triangles near a cell that reach the plane of the turn; false: there are too many.
bool gather(const Colliders& colliders, const Vec3d& pivot, const Turning& turning, const Vec3d& centre,
            double radius, bool all, TurnScratch& scratch) {
    const double c = turning.clearance * (1.0 + 1e-12) + turning.length * 1e-12;
    if (!find_near(colliders, pivot + centre, radius + c, all ? SIZE_MAX : few, scratch)) return false;
    for (const FoundTriangle& found : scratch.found) {
        auto p = colliders.corners(*found.mesh, found.triangle);
        double h[3];
        for (size_t i = 0; i < 3; ++i) {
            p[i] -= pivot;
            h[i] = p[i].dot(turning.normal);
        }
        const double highest = std::max({h[0], h[1], h[2]}), lowest = std::min({h[0], h[1], h[2]});
        if (lowest <= c && highest >= -c) scratch.triangles.push(p[0], p[1], p[2]);
    }
    return true;
}

// Visits all triangles that matter between two turns, in angles; `visit` returns the angle up to which it still matters.
template <typename Visit>
void sweep_cells(const Colliders& colliders, const Vec3d& pivot, const Turning& turning, double begin,
                 double end, bool from_root, TurnScratch& scratch, Visit&& visit) {
    Cell stack[3 * deepest + 8];
    int top = 0;
    const bool narrow = end - begin <= 0.25, crowded = scratch.crowded > 0;
    if (crowded) --scratch.crowded;
    double far = turning.length;
    if (crowded && narrow) { // along the skin: pieces side by side
        for (int i = pieces; i-- > 0;)
            stack[top++] = {far * i / pieces, far * (i + 1) / pieces, begin, end, 0};
    } else {
        // A root stands on the skin, and its segment leaves it: cells that halve towards it keep clear of the skin where one
        // ball around all would not.
        for (int i = 0; crowded && from_root && i < root_halvings; ++i, far *= 0.5)
            stack[top++] = {0.5 * far, far, begin, end, 0};
        stack[top++] = {0.0, far, begin, end, 0};
    }
    const double grain = 0x1p-20 * pivot.cwiseAbs().maxCoeff();
    double limit = end;
    while (top > 0) {
        Cell cell = stack[--top];
        if (cell.begin > limit) continue;
        cell.end = std::min(cell.end, limit);
        Vec3d centre;
        double radius;
        bounding_sphere(cell, turning, centre, radius);
        // No question is finer than the clearance, nor than the floats that Embree's boxes are made of.
        const bool last = cell.depth >= deepest || radius <= std::max(turning.clearance, grain);
        if (gather(colliders, pivot, turning, centre, radius, last, scratch)) {
            if (scratch.triangles.size() > 0) limit = std::min(limit, visit(cell));
            continue;
        }
        if (cell.depth == 0) scratch.crowded = crowded_memory;
        const double along = cell.far - cell.near, across = cell.far * (cell.end - cell.begin);
        ++cell.depth;
        const Cell whole = cell;
        if (across > along) {
            const double middle = 0.5 * (cell.begin + cell.end);
            cell.begin = middle;
            stack[top++] = cell;
            cell = whole;
            cell.end = middle;
            stack[top++] = cell;
        } else {
            const int parts = across < 0.25 * along ? pieces : 2;
            for (int i = parts; i-- > 0;) {
                cell.near = whole.near + along * i / parts;
                cell.far = whole.near + along * (i + 1) / parts;
                stack[top++] = cell;
            }
        }
    }
}

struct Sweep {
    bool blocked_at_start, not_clear;
    double first; // angle of the first contact; infinity: none
    Vec2d at;     // its cosine and sine
};

Sweep sweep(const Colliders& colliders, const Segment& segment, const Arc& arc, TurnScratch& scratch) {
    Sweep result{false, false, std::numeric_limits<double>::infinity(), Vec2d::Zero()};
    double end = diamond_of_angle(arc.angle);
    sweep_cells(colliders, segment.pivot, arc.turning, 0.0, arc.angle, segment.doubted, scratch,
                [&](const Cell& cell) {
                    // Whatever is nearer to the pivot than the clearance is near the cells that begin there.
                    if (segment.doubted && cell.near == 0.0 &&
                        !clear_of_pivot(scratch.triangles.blocks(), segment.clearance * 1.1)) {
                        result.not_clear = true;
                        return -1.0;
                    }
                    scratch.blocked.clear();
                    blocked_turns(arc.turning, 0.0, end, scratch.triangles.blocks(), scratch.triangles.size(),
                                  scratch.blocked);
                    double limit = arc.angle;
                    for (const Blocked& blocked : scratch.blocked) {
                        if (blocked.low < 0.0) {
                            result.blocked_at_start = true;
                            return -1.0;
                        }
                        if (blocked.low > end) continue;
                        end = blocked.low;
                        result.at = undiamond(end);
                        result.first = limit = std::max(std::atan2(result.at.y(), result.at.x()), 0.0);
                    }
                    return std::min(limit, result.first);
                });
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
    ray.mask = ~0U;
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

// Out of a collider within one plane: equal steps to both sides are tried until one is free, first by a ray, then by its
// whole capsule; from there it turns back, at most that one step, to the contact.
// Returns how far it has turned; more than pi: the plane has no free direction within `most`.
double turn_out_in_plane(const Colliders& colliders, const Segment& segment, const Turning& turning,
                         double most, TurnScratch& scratch, Vec3d& direction) {
    constexpr double step = pi / out_steps;
    for (int i = 1; i <= out_steps && step * (i - 1) < most; ++i) {
        double least = std::numeric_limits<double>::infinity();
        for (const double side : {1.0, -1.0}) {
            const double angle = side * step * i, before = side * step * (i - 1);
            Segment back = segment;
            back.from = turning.direction(std::cos(angle), std::sin(angle)).normalized();
            if (ray_meets(colliders, back.pivot, back.from, back.length)) continue;
            back.goal = turning.direction(std::cos(before), std::sin(before)).normalized();
            const Arc arc = arc_of(back);
            const Sweep found = sweep(colliders, back, arc, scratch);
            if (found.blocked_at_start) continue;
            const double turned = step * i - std::min(found.first, step);
            if (turned >= least) continue;
            least = turned;
            direction =
                found.first > arc.angle ? back.goal : arc.turning.direction(found.at.x(), found.at.y());
        }
        if (least <= pi) return least;
    }
    return 2.0 * pi;
}

// The plane of `from` and the way from the nearest triangle to the pivot, which has come from outside: straight out. Where
// the goal is close to `from` the arc's plane is as good as arbitrary: turning out in it alone makes strands curl sideways,
// and jump from one frame to the next.
bool plane_straight_out(const Colliders& colliders, const Segment& segment, Turning& turning) {
    const NearestTriangle nearest = nearest_triangle(colliders, segment.pivot, segment.length);
    if (!nearest.mesh) return false;
    const Vec3d away = segment.pivot - nearest.point;
    const Vec3d across = away - segment.from * away.dot(segment.from);
    if (!(across.squaredNorm() > 1e-12 * away.squaredNorm())) return false;
    turning.across = across.normalized();
    turning.normal = turning.from.cross(turning.across).normalized();
    return true;
}

// Planes turned about `from` away from the arc's, the nearest first.
bool turn_out(const Colliders& colliders, const Segment& segment, const Arc& arc, int planes,
              TurnScratch& scratch, Vec3d& direction) {
    for (int i = 0; i < planes; ++i) {
        const double turn = pi / double(planes) * double(i % 2 == 0 ? -(i / 2) : (i + 1) / 2);
        Turning turning = arc.turning;
        turning.clearance = segment.clearance;
        turning.across = arc.turning.across * std::cos(turn) + arc.turning.normal * std::sin(turn);
        turning.normal = turning.from.cross(turning.across);
        double least = 2.0 * pi;
        if (i == 0) {
            Turning straight = turning;
            if (plane_straight_out(colliders, segment, straight))
                least = turn_out_in_plane(colliders, segment, straight, pi, scratch, direction);
        }
        Vec3d other;
        if (turn_out_in_plane(colliders, segment, turning, std::min(least, pi), scratch, other) < least)
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

// Nothing is free: the direction that runs the longest before it meets a triangle.
Vec3d least_bad(const Colliders& colliders, const Segment& segment, const Arc& arc) {
    constexpr int planes = 16, turns = 16;
    Vec3d best = segment.from;
    double longest = free_length(colliders, segment, best);
    for (int i = 0; i < planes; ++i)
        for (int j = 1; j < 2 * turns; ++j) {
            const double plane = pi * i / planes, turn = pi * (j - turns) / turns;
            const Vec3d across = arc.turning.across * std::cos(plane) + arc.turning.normal * std::sin(plane);
            const Vec3d direction = segment.from * std::cos(turn) + across * std::sin(turn);
            const double length = free_length(colliders, segment, direction);
            if (length <= longest) continue;
            longest = length;
            best = direction;
        }
    return best;
}

} // namespace

bool anything_near(const Colliders& colliders, const Vec3d& centre, double radius) {
    bool any = false;
    near_triangles(colliders, centre, radius, [&](const MarramMesh& mesh, uint32_t triangle, double) {
        const auto p = colliders.corners(mesh, triangle);
        const Eigen::Array3d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]),
                             high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
        const Eigen::Array3d out = (low - centre.array()).max(centre.array() - high).max(0.0);
        if (out.matrix().squaredNorm() > radius * radius) return radius; // by its box: most are
        any = any || (nearest_point(p, centre) - centre).squaredNorm() <= radius * radius;
        return any ? -1.0 : radius;
    });
    return any;
}

bool triangles_near(const Colliders& colliders, const Vec3d& centre, double radius, size_t most,
                    TurnScratch& scratch) {
    if (!find_near(colliders, centre, radius, most, scratch)) return false;
    for (const FoundTriangle& found : scratch.found) {
        auto p = colliders.corners(*found.mesh, found.triangle);
        for (Vec3d& corner : p) corner -= centre;
        const Eigen::Array3d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]),
                             high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
        if (low.max(-high).max(0.0).matrix().squaredNorm() <= radius * radius)
            scratch.triangles.push(p[0], p[1], p[2]);
    }
    return true;
}

Arc arc_of(const Segment& segment) {
    const Vec3d &a = segment.from, &g = segment.goal;
    const double cosine = a.dot(g);
    Vec3d axis = a.cross(g);
    double sine = axis.norm();
    if (sine <= opposed && !(cosine > 0.0 && sine > 0.0)) {
        // Opposed, or the same: no plane is better than that of the strand's own lean.
        axis = a.cross(segment.lean);
        if (!(axis.squaredNorm() > 1e-12 * segment.lean.squaredNorm())) {
            Eigen::Index least;
            a.cwiseAbs().minCoeff(&least);
            axis = a.cross(Vec3d::Unit(least));
        }
        sine = 0.0;
    }
    // Of nearly equal directions the cross product is good to 1e-16 / sine only: made perpendicular once more.
    const Vec3d across = axis.normalized().cross(a).normalized();
    const Vec3d normal = a.cross(across).normalized();
    return {{a, across, normal, segment.length, segment.clearance}, std::atan2(sine, cosine)};
}

Turned turn_exactly(const Colliders& colliders, const Segment& given, TurnScratch& scratch) {
    Segment segment = given;
    Arc arc = arc_of(segment);
    Sweep found = sweep(colliders, segment, arc, scratch);
    // Planes and boxes have raised the doubt, or a start that is blocked has ended the sweep before all that is near the pivot
    // was seen: now it is measured.
    if (found.not_clear || (found.blocked_at_start && segment.doubted)) {
        if (anything_near(colliders, segment.pivot, segment.clearance * 1.1))
            return {segment.from, Outcome::not_clear, false, 0.0};
        segment.doubted = false;
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
            return {least_bad(colliders, segment, arc), Outcome::unresolved, true, 0.0, goal_angle, 0.0};
        // From there towards the goal. It stands at its clearance exactly, so it goes on with a little less.
        segment.from = out.normalized();
        segment.clearance *= 1.0 - 1e-6;
        // Mostly it stands against the collider that the goal is behind, and touches at once.
        arc = arc_of(segment);
        constexpr double at_once = 0.05;
        Arc near = arc;
        near.angle = std::min(arc.angle, at_once);
        found = sweep(colliders, segment, near, scratch);
        if (!found.blocked_at_start && found.first > near.angle && near.angle < arc.angle)
            found = sweep(colliders, segment, arc, scratch);
        if (found.blocked_at_start)
            return {segment.from,      Outcome::contact, true,
                    segment.clearance, goal_angle,       goal_angle - arc.angle};
    }
    if (found.first > arc.angle)
        return {segment.goal, Outcome::arrived, pushed_out, segment.clearance, goal_angle, goal_angle};
    return {arc.turning.direction(found.at.x(), found.at.y()).normalized(),
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
    const auto at = [&](double turn) { return arc.turning.direction(std::cos(turn), std::sin(turn)); };
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
