// SPDX-License-Identifier: Apache-2.0
// Bounds on the distance between a segment that rotates about its start and one triangle.
//
// The segment's points are P + s u(theta), 0 <= s <= l, u(theta) = u cos(theta) + v sin(theta), v = axis x u.
//
//  Free. For any unit n, the distance from the points s0 <= s <= s1 at the angle m + tau to the triangle T is
//  at least min over s of s (A cos tau + B sin tau) - max over T of n . (z - P), A = n . u(m), B = n . u'(m):
//  the width of a slab between them. The maximum is at a corner. The minimum is at s0 or s1 and, for |tau| <=
//  h, at an end of that range or where the cosine is -1. Candidates for n are the direction between the
//  closest points at m, the triangle's normal, and the vectors perpendicular to the segment and one edge; the
//  last are exact for sliding along an edge, where the first is only rounding. Also, no point moves further
//  than the chord 2 s1 sin(h / 2), so the distance is at least the one at m minus that. Any bound above c
//  over the whole range suffices. Over narrow ranges the segment is halved, down to a sixteenth, each part
//  with its own n, because a slab close to the pivot is a poor bound for the far end.
//
//  Blocked. If the distance is below c at two angles less than pi apart, with points x0, x1 of the segment
//  and y0, y1 of T, then it is below c at every angle between: the ray at that angle meets the line x0 x1 at
//  some (1 - a) x0 + a x1 whose distance from P is at most l, and (1 - a) y0 + a y1 lies in T and is nearer
//  to it than c. For c = 0 the same with crossings. So the blocked angles of a triangle are one interval
//  within any half turn.
//
// Bounds hold up to the rounding of distances, about 1e-15 (l + |P - y|): all is computed relative to P.
#pragma once

#include "tests/oracle/triangles.h"

namespace marram::oracle {

struct Sweep {
    Vec3d u, v;       // unit and perpendicular: directions at 0 and at a quarter turn
    double length;    // l
    double clearance; // c >= 0; free means distance >= c where c > 0, not touching where c = 0

    Vec3d direction(double angle) const { return u * std::cos(angle) + v * std::sin(angle); }
};

// Triangles relative to the pivot.
bool is_free(const Sweep& sweep, double angle, const Triangle& t);
// True if proven free at every angle from `middle - half` to `middle + half`; false leaves it open.
bool proven_free(const Sweep& sweep, double middle, double half, const Triangle& t);

} // namespace marram::oracle
