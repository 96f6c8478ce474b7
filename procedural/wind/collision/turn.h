// SPDX-License-Identifier: Apache-2.0
// One segment of a strand among colliders: how far it turns from its start direction towards its goal.
#pragma once

#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/collision/contact.h"

#include <vector>

namespace marram {

// A segment that starts at `pivot`, which is farther than `clearance` from every triangle (unless
// clearance_unverified).
struct Segment {
    Vec3d pivot, from, goal; // directions are unit vectors
    Vec3d lean;              // to the tip, any length or 0: picks the plane if from and goal are opposed
    double length, clearance;
    bool clearance_unverified = false; // check the pivot's clearance
    bool test_ray_first = false;       // rotated by earlier turns, perhaps into a collider: test a ray first
};

enum class Outcome {
    arrived,
    contact,
    unresolved,
    not_clear
}; // not_clear: the unverified pivot may be too close to a triangle

struct Turned {
    Vec3d direction;
    Outcome outcome;
    bool pushed_out;  // `from` was not free
    double clearance; // of the result; less than requested if no direction had more
    double goal_angle = 0.0,
           turned_angle = 0.0; // angle from `from` to the goal, and the part of it that was turned
};

// The plane of a turn: across = the component of goal perpendicular to from, normalised. If they are opposed,
// the axis is from x lean; without a lean, it is from x the coordinate axis that `from` has the smallest
// component along.
struct Arc {
    TurningCapsule capsule;
    double angle; // to the goal, 0 ... pi
};
Arc arc_of(const Segment& segment);

// Per-thread buffers, kept from segment to segment.
struct TurnScratch {
    TriangleList triangles, kept;
    TriangleList contact_triangle; // the triangle that a turned-out segment touches
    FirstBlocked first;
    std::vector<NearCluster> clusters;
    std::vector<Blocked> blocked;
};

// Exact: rotates `from` by the shortest arc to `goal`, up to the first angle at which the segment is closer
// to a triangle than its clearance. If `from` is not free, it is first turned out:
//
//   1. in the plane of its arc or, if that is a smaller turn, straight out: in the plane of `from` and the
//      direction from the closest point to the pivot (free ranges narrower than 1/16 of a half turn may be
//      missed);
//   2. if that plane has no free direction, in planes rotated about `from` by multiples of 1/16 of a half
//      turn, smallest first;
//   3. if none has one, again with a quarter of the clearance, down to 1e-6 lengths (there by multiples of
//      1/64).
//
// Otherwise it is unresolved, and the result is the direction with the longest free ray of those tried. A
// segment that was turned out and would touch again within 1e-6 rad on its way to the goal stays. Contact
// angles are good to 1e-9 rad except at grazing contact.
Turned turn_exactly(const Colliders& colliders, const Segment& segment, TurnScratch& scratch);

// The talk's method: `steps` equal turns, each tested by a ray along the segment; the last free one is kept.
// A segment that is not free at the start is turned out by up to as many such steps, to either side.
Turned turn_by_steps(const Colliders& colliders, const Segment& segment, int steps);

// True: the distance from the centre to some triangle is at most the radius.
bool any_triangle_within(const Colliders& colliders, const Vec3d& centre, double radius,
                         TurnScratch& scratch);

// True: no triangle is within the region. False: one may be.
bool region_is_clear(const Colliders& colliders, const SearchRegion& region, TurnScratch& scratch);

// Fills scratch.triangles, relative to `origin`, with all triangles that may be within the region. False:
// they are in more than `most` clusters; the list is left empty.
bool triangles_near(const Colliders& colliders, const SearchRegion& region, const Vec3d& origin, size_t most,
                    TurnScratch& scratch);

// True: a ray of that length hits a triangle.
bool ray_meets(const Colliders& colliders, const Vec3d& from, const Vec3d& direction, double length);

} // namespace marram
