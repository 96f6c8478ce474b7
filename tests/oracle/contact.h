// SPDX-License-Identifier: Apache-2.0
// One segment that turns about its start among triangles: first contact, first free angle, any free
// direction.
//
// Angles are found by halving an interval, left half first. With it goes the list of triangles that are not
// proven free over it (sweep.h), which shrinks with the interval; an empty list proves the interval free.
// Looking for a contact, the first interval of width 1e-10 rad that cannot be proven free is the contact, and
// its left end the answer: everything before it is proven free. Looking for a free angle, an interval that
// one triangle blocks from end to end is left out, the first one proven free is the answer, and gaps narrower
// than 1e-10 rad are not seen. A search that needs more than a million intervals (none known) throws
// std::runtime_error rather than never return.
#pragma once

#include "tests/oracle/triangle_set.h"

#include <optional>

namespace marram::oracle {

constexpr double angle_tolerance = 1e-10;

struct Contact {
    double angle = 0.0; // of the first contact; the whole turn if there is none
    bool touches = false;
    // The same with clearances greater and less by the margin asked for: a graze is where these two lie far
    // apart, and an answer between them is as good as `angle`.
    double earliest = 0.0, latest = 0.0;
    bool grazes(double angle_margin) const { return latest - earliest > angle_margin; }
};

// Distance of the segment from the set >= c (for c = 0: touches nothing).
bool is_free(const Vec3d& pivot, const Vec3d& u, double length, double c, const TriangleSet& set);
// Turning by `whole` (0 to 2 pi) about `axis`, perpendicular to u. A segment that is not free at the start
// touches at 0. margin: a length, for earliest and latest; 0: both are `angle`, at a third of the cost.
Contact first_contact(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double whole, double length,
                      double c, const TriangleSet& set, double margin = 0.0);
// Smallest turn in [0, 2 pi) about `axis` to a direction with clearance c, if there is one.
std::optional<double> first_free(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double length,
                                 double c, const TriangleSet& set);
// A direction with clearance c (0: crossing no triangle), sought among `samples` directions spread evenly
// over the sphere and, if none of those is free, around the ones that came nearest to it. It may miss a gap
// narrower than the samples' spacing, some 2 / sqrt(samples / pi) rad. Nothing is free where the pivot itself
// is too near.
std::optional<Vec3d> any_free_direction(const Vec3d& pivot, double length, double c, const TriangleSet& set,
                                        int samples = 40000);

} // namespace marram::oracle
