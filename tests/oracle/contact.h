// SPDX-License-Identifier: Apache-2.0
// One segment that rotates about its start among triangles: first contact, first free angle, any free
// direction.
//
// Angles are found by bisection, left half first. Each interval has a list of the triangles that are not
// proven free over it (sweep.h), which shrinks with the interval; an empty list proves the interval free.
// First contact: the left end of the first interval of width 1e-10 rad that cannot be proven free; everything
// before it is proven free. First free angle: the first interval that is proven free. Intervals that one
// triangle blocks from end to end are skipped, and gaps narrower than 1e-10 rad are missed. A search that
// needs more than a million intervals (none known) throws std::runtime_error.
#pragma once

#include "tests/oracle/triangle_set.h"

#include <optional>

namespace marram::oracle {

constexpr double angle_tolerance = 1e-10;

struct Contact {
    double angle = 0.0; // of the first contact; the whole rotation if there is none
    bool touches = false;
    // The angle with the clearance increased and decreased by the margin. If they are far apart, the contact
    // is grazing, and any answer between them is as good as `angle`.
    double earliest = 0.0, latest = 0.0;
    bool grazes(double angle_margin) const { return latest - earliest > angle_margin; }
};

// True if the segment's distance from the set is >= c (for c = 0: it touches nothing).
bool is_free(const Vec3d& pivot, const Vec3d& u, double length, double c, const TriangleSet& set);
// Contact of a rotation by `whole` (0 to 2 pi) about `axis`, which is perpendicular to u. A segment that is
// not free at the start touches at 0. margin: a length, for earliest and latest; 0: both equal `angle`, at a
// third of the cost.
Contact first_contact(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double whole, double length,
                      double c, const TriangleSet& set, double margin = 0.0);
// Smallest rotation in [0, 2 pi) about `axis` to a direction with clearance c, if there is one.
std::optional<double> first_free(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double length,
                                 double c, const TriangleSet& set);
// A direction with clearance c (0: crossing no triangle). Tries `samples` directions spread evenly over the
// sphere and, if none of them is free, searches around the best ones. It may miss a gap narrower than the
// samples' spacing, about 2 / sqrt(samples / pi) rad. Nothing is free if the pivot itself is too close.
std::optional<Vec3d> any_free_direction(const Vec3d& pivot, double length, double c, const TriangleSet& set,
                                        int samples = 40000);

} // namespace marram::oracle
