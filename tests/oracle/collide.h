// SPDX-License-Identifier: Apache-2.0
// "Bend around" (chain.md, Collision): a strand turned segment by segment from its rest pose towards its
// targets.
//
// Segment k starts as the rest segment carried along by the turns made nearer the root, composed into one
// rotation R. Its goal is the direction from C_k to target k + 1. If the start is free it turns towards the
// goal until it arrives or touches. If not, it is first turned to the nearest of the first free directions
// in the plane of its arc (one for each sense of turning) and, where `straight_out`, in the plane that holds the way
// from the nearest triangle to the pivot, then from there by the shortest arc towards the
// goal until it touches; on the far side that is at once. If the plane has none, planes through the start
// direction are tried that stand j pi / 8 off the first one, j = 1 to 7, and the first with a free direction
// is taken. If none has, the segment stays where it starts and counts as unresolved. Where the segment starts
// in its goal's direction, or opposite to it, the plane is that of turn.h's rule.
#pragma once

#include "tests/oracle/contact.h"

namespace marram::oracle {

struct SegmentTurn {
    Vec3d direction = Vec3d::Zero(); // final, unit
    Vec3d axis = Vec3d::Zero();      // the turn from the start to `direction`
    double angle = 0.0;
    double goal_angle = 0.0; // between start and goal
    double remaining = 0.0;  // between `direction` and goal
    double out_angle = 0.0;  // turned to get free first; 0 if the start is free
    Contact contact;         // of the turn towards the goal, its angles counted from where that turn starts
    bool pivot_free = true;  // false: the pivot itself is too near, so every direction is
    bool start_free = true, unresolved = false;
};

// One segment from a given state. `start`, `goal`: unit; `tip`: from the pivot to the tip, for the plane's
// rule.
SegmentTurn turn_segment(const Vec3d& pivot, const Vec3d& start, const Vec3d& goal, const Vec3d& tip,
                         double length, double clearance, const TriangleSet& set, double margin = 0.0,
                         bool straight_out = true);

struct StrandTurn {
    std::vector<Vec3d> cvs;
    std::vector<SegmentTurn> segments;
    int unresolved = 0;
    // Sums over the segments of max(0, goal_angle - remaining) and of goal_angle: their quotient is the share
    // of the way.
    double turned = 0.0, goal = 0.0;
};

// clearances: c_k of every segment. Lengths are those of the rest strand.
StrandTurn collide_strand(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& targets,
                          const std::vector<double>& clearances, const TriangleSet& set, double margin = 0.0,
                          bool straight_out = true);

} // namespace marram::oracle
