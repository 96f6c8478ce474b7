// SPDX-License-Identifier: Apache-2.0
// Bounds on the distance between a segment that turns about its start and one triangle.
//
// The segment's points are P + s u(theta), 0 <= s <= l, u(theta) = u cos(theta) + v sin(theta), v = axis x u.
//
//  Free. For any unit n, the points s0 <= s <= s1 at the angle m + tau are no nearer to the triangle T than
//  min over s of s (A cos tau + B sin tau) - max over T of n . (z - P), A = n . u(m), B = n . u'(m): a slab
//  of that width lies between them. The maximum is at a corner, the minimum at s0 or s1, and for |tau| <= h
//  at an end of that range or where the cosine is -1. As n serve the direction between nearest points at m,
//  the triangle's normal, and the vectors across the segment and one edge; the last are exact where the first
//  is all rounding, sliding along an edge. Also, no point moves further than the chord 2 s1 sin(h / 2), so
//  the distance is at least the one at m minus that. Whatever shows a distance above c over the whole range
//  counts; over narrow ranges the segment is cut in halves, down to a sixteenth, each with its own n, for a
//  slab that lies right by the pivot knows nothing of the far end's lever.
//
//  Blocked. If the distance is below c at two angles less than pi apart, with points x0, x1 of the segment
//  and y0, y1 of T, then it is below c at every angle between: the ray at that angle meets the line x0 x1 at
//  some (1 - a) x0 + a x1 whose distance from P is at most l, and (1 - a) y0 + a y1 lies in T and is nearer
//  to it than c. For c = 0 the same with crossings. So the blocked angles of a triangle are one interval
//  within any half turn.
//
// Bounds hold up to the rounding of distances, some 1e-15 (l + |P - y|): everything is done relative to P.
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
// Free at every angle from `middle - half` to `middle + half` (true is proven, false may be either).
bool proven_free(const Sweep& sweep, double middle, double half, const Triangle& t);

} // namespace marram::oracle
