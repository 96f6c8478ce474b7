// SPDX-License-Identifier: Apache-2.0
// "Bend around" (chain.md, Collision): a strand is rotated segment by segment from its rest pose towards its
// targets.
//
// Segment k starts as the rest segment, rotated by R, the product of all rotations nearer to the root. Its
// goal is the direction from C_k to target k + 1. If the start is free, it rotates towards the goal until it
// arrives or touches. If not, it first rotates out of the mesh, to the nearest of the first free directions
// in the plane of its arc (one for each sense of rotation) and, with `straight_out`, in the plane that
// contains the direction from the nearest triangle to the pivot. From there it rotates by the shortest arc
// towards the goal until it touches; on the far side that is at once. If the plane has no free direction,
// planes through the start direction at the angles j pi / 8 to the first one are tried, j = 1 to 7, and the
// first with a free direction is used. If none has one, the segment stays at its start and counts as
// unresolved. If the start direction is the goal's or opposite to it, turn.h's rule defines the plane.
#pragma once

#include "tests/oracle/contact.h"

namespace marram::oracle {

struct SegmentTurn {
    Vec3d direction = Vec3d::Zero(); // final, unit
    Vec3d axis = Vec3d::Zero();      // of the rotation from the start to `direction`
    double angle = 0.0;
    double goal_angle = 0.0; // between start and goal
    double remaining = 0.0;  // between `direction` and goal
    double out_angle = 0.0;  // rotation out of the mesh; 0 if the start is free
    Contact contact;         // of the rotation towards the goal; angles are counted from its start
    bool pivot_free = true;  // false: the pivot is too close, so no direction is free
    bool start_free = true, unresolved = false;
};

// One segment from a given state. `start`, `goal`: unit; `tip`: from the pivot to the tip, for the rule of
// the plane.
SegmentTurn turn_segment(const Vec3d& pivot, const Vec3d& start, const Vec3d& goal, const Vec3d& tip,
                         double length, double clearance, const TriangleSet& set, double margin = 0.0,
                         bool straight_out = true);

struct StrandTurn {
    std::vector<Vec3d> cvs;
    std::vector<SegmentTurn> segments;
    int unresolved = 0;
    // Sums over the segments of max(0, goal_angle - remaining) and of goal_angle. Their ratio is the reached
    // fraction of the way to the goal.
    double turned = 0.0, goal = 0.0;
};

// clearances: c_k of every segment. Lengths are those of the rest strand.
StrandTurn collide_strand(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& targets,
                          const std::vector<double>& clearances, const TriangleSet& set, double margin = 0.0,
                          bool straight_out = true);

} // namespace marram::oracle
