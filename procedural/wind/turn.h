// SPDX-License-Identifier: Apache-2.0
// One segment of a strand among colliders: how far it turns from where it is towards where it wants to be.
#pragma once

#include "procedural/wind/colliders.h"
#include "procedural/wind/contact.h"

#include <vector>

namespace marram {

// A segment that starts in `pivot`, which is farther than `clearance` from every triangle, unless that is doubted.
struct Segment {
    Vec3d pivot, from, goal; // directions are unit vectors
    Vec3d lean; // of the strand behind it: decides the way where from and goal are opposed; may be 0
    double length, clearance;
    bool clearance_unverified = false; // the pivot's clearance is to be checked
    bool carried = false; // by turns nearer the root, perhaps into a collider: a ray is asked first
};

enum class Outcome {
    arrived,
    contact,
    unresolved,
    not_clear
}; // not_clear: of a doubted pivot, which may be too near

struct Turned {
    Vec3d direction;
    Outcome outcome;
    bool pushed_out;  // `from` was not free
    double clearance; // what the result is free by; less than asked where there was no other way
    double goal_angle = 0.0, turned_angle = 0.0; // how far it was to the goal, and how much nearer it came
};

// The plane of a turn: across = the goal's part perpendicular to from. Where they are opposed the axis is that of the
// strand's own lean, from x lean, else a fixed rule: across the coordinate axis that `from` is least along.
struct Arc {
    Turning turning;
    double angle; // to the goal, 0 ... pi
};
Arc arc_of(const Segment& segment);

// What a thread keeps from segment to segment.
struct TurnScratch {
    TriangleList triangles, kept;
    TriangleList against; // what a segment that was turned out stands against
    FirstBlocked first;
    std::vector<NearCluster> clusters;
    std::vector<Blocked> blocked;
};

// Exact: from `from` by the shortest arc to `goal`, up to the first turn at which the segment is nearer than its clearance
// to a triangle. Where `from` is not free it is first turned out: in the plane of its arc or, if that is a smaller turn,
// straight out, in the plane of `from` and the way from the nearest triangle to the pivot (free ranges narrower than
// 1/16 of a half turn may be missed); if that plane has no free direction, in planes turned about `from` by 1/16
// of a half turn and its multiples, nearest first; if none has one, again with a quarter of the clearance, down to 1e-6
// lengths. Then it is unresolved: of the directions tried the one that runs free the longest. One that was turned out and would
// touch again within 1e-6 rad on its way to the goal stays.
// Contact angles are good to 1e-9 rad away from grazing contact.
Turned turn_exactly(const Colliders& colliders, const Segment& segment, TurnScratch& scratch);

// The talk's way: `steps` equal turns, each tested by a ray along the segment; the last free one is kept. A segment that is
// not free at the start is turned out by such steps, to either side, as many as there are.
Turned turn_by_steps(const Colliders& colliders, const Segment& segment, int steps);

// Whether a triangle is nearer to the centre than the radius.
bool anything_near(const Colliders& colliders, const Vec3d& centre, double radius, TurnScratch& scratch);

// True: no triangle comes near the region. False: one may.
bool surely_clear(const Colliders& colliders, const Region& region, TurnScratch& scratch);

// Fills scratch.triangles with those that may come near the region, relative to `origin`. False: they are in more than `most`
// clusters, and not filled in.
bool triangles_near(const Colliders& colliders, const Region& region, const Vec3d& origin, size_t most,
                    TurnScratch& scratch);

// Whether a ray of that length from the pivot meets a triangle.
bool ray_meets(const Colliders& colliders, const Vec3d& from, const Vec3d& direction, double length);

} // namespace marram
