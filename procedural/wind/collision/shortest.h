// SPDX-License-Identifier: Apache-2.0
// The shortest vector from a segment to a triangle, for eight triangles at once: from one of its ends to the
// interior of the triangle, or from the segment to an edge. If they cross, the result is still one of those.
#pragma once

#include "procedural/wind/collision/contact.h"

#include <limits>

namespace marram {

// Keeps the shortest of the vectors it is given.
struct alignas(64) Shortest {
    Wide3d v{};
    VDouble squared = splat(std::numeric_limits<double>::infinity());
    MARRAM_INLINE void take(const Wide3d& r) {
        const VDouble rr = dot(r, r);
        const VLong shorter = rr < squared;
        v = select(shorter, r, v);
        squared = select(shorter, rr, squared);
    }
};

MARRAM_INLINE Wide3d to_edge(const Wide3d& a, const Wide3d& b, const Wide3d& p) {
    const Wide3d e = b - a, d = p - a;
    const VDouble ee = dot(e, e);
    const VDouble t = vmin(vmax(dot(d, e) / select(ee > 0.0, ee, 1.0), VDouble{}), 1.0);
    return e * t - d;
}

// From a point to the interior of a triangle, along its normal; very long if the projection is outside.
MARRAM_INLINE Wide3d to_face(const Triangles8& t, const Wide3d& p) {
    const Wide3d ab = t.corner[1] - t.corner[0], ac = t.corner[2] - t.corner[0], ap = p - t.corner[0];
    const Wide3d n = cross(ab, ac);
    const VDouble nn = dot(n, n), v = dot(cross(ap, ac), n), w = dot(cross(ab, ap), n);
    const VLong inside = (v >= 0.0) & (w >= 0.0) & (v + w <= nn) & (nn > 0.0);
    const VDouble far = splat(1e300) / vmax(dot(ap, ap), 1.0);
    const VDouble s = -dot(ap, n) / select(nn > 0.0, nn, 1.0);
    return select(inside, n * s, Wide3d{far, far, far} * splat(1e-200));
}

// From the first segment to the second (Ericson, 5.1.9): clamped on one, then on the other.
MARRAM_INLINE Wide3d between(const Wide3d& p, const Wide3d& d, const Wide3d& a, const Wide3d& b) {
    const Wide3d e = b - a, r = p - a;
    const VDouble dd = dot(d, d), ee = dot(e, e), de = dot(d, e), dr = dot(d, r), er = dot(e, r);
    const VDouble zero{}, one = splat(1.0), slant = dd * ee - de * de;
    const VLong skew = slant > 1e-14 * dd * ee;
    VDouble s = select(skew, (de * er - dr * ee) / select(skew, slant, one), zero);
    s = vmin(vmax(s, zero), one);
    VDouble t = (de * s + er) / select(ee > 0.0, ee, one);
    t = vmin(vmax(t, zero), one);
    s = (de * t - dr) / select(dd > 0.0, dd, one);
    s = vmin(vmax(s, zero), one);
    return (e * t - r) - d * s;
}

// From the segment p q to the triangle.
MARRAM_INLINE Shortest shortest_vector(const Wide3d& p, const Wide3d& q, const Triangles8& t) {
    const Wide3d d = q - p;
    Shortest shortest;
    shortest.take(to_face(t, p));
    shortest.take(to_face(t, q));
    for (int i = 0; i < 3; ++i) {
        const Wide3d &a = t.corner[i], &b = t.corner[(i + 1) % 3];
        shortest.take(between(p, d, a, b));
        shortest.take(to_edge(a, b, p)); // for parallel segments
        shortest.take(to_edge(a, b, q));
    }
    return shortest;
}

} // namespace marram
