// SPDX-License-Identifier: Apache-2.0
// Offset scale: targets are pushed away from the skin to at least offset_scale times their rest height.
//
// The closest point of a rest CV is searched on the skin triangles that face like the root (n . n_root > 0),
// that of a bent CV on the triangles that face like the triangle of the rest CV's closest point. The height
// is the distance from the closest point, with the sign of (P - closest) . n. If several triangles are
// equally close (the closest point is on an edge or corner), the one with the greatest |n . (P - closest)| is
// used: the only choice with the right sign at any corner of a closed mesh. While P is lower than
// offset_scale h_rest (from the second step on: than 0.98 of that), it moves by the missing height along the
// normal of the rest CV's closest point, four times at most. CVs without a closest point are skipped.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

struct SkinPoint {
    bool found = false;
    bool on_edge = false; // several triangles are equally close; the choice of the normal is a convention
    Vec3d point = Vec3d::Zero(), normal = Vec3d::Zero();
    double height = 0.0;
};
SkinPoint closest_on_skin(const Vec3d& p, const Vec3d& facing, const TriangleSet& skin);

struct Pushed {
    std::vector<Vec3d> cvs;
    std::vector<double> push;  // per CV, m
    std::vector<bool> on_edge; // either closest point is on an edge
    int skipped = 0;
};
// The root, CV 0, does not move.
Pushed push_targets(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& bent, const Vec3d& root_normal,
                    double offset_scale, const TriangleSet& skin);

} // namespace marram::oracle
