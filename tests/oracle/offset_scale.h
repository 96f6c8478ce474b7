// SPDX-License-Identifier: Apache-2.0
// Offset scale: targets pushed out along the skin until they stand at offset_scale times their rest height.
//
// The closest of a rest CV is the nearest point of the skin among triangles that face as the root does (n .
// n_root > 0), the closest of a bent CV the nearest among those that face as the rest closest's triangle does.
// Height is the distance from the closest, negative below it: the sign is that of (P - closest) . n. Where several
// triangles are equally near (the closest lies on an edge or corner) the one that n . (P - closest) is greatest in
// size for is the closest's triangle: the only choice whose sign is right on a closed mesh for any corner. While
// it stands lower than offset_scale h_rest (from the second time on: than 0.98 of that), P moves by what is missing along
// the normal of the rest closest, four times at most. No such closest: skipped.
#pragma once

#include "tests/oracle/triangle_set.h"

namespace marram::oracle {

struct SkinPoint {
    bool found = false;
    bool on_edge =
        false; // several triangles are equally near: which normal is taken is a matter of convention
    Vec3d point = Vec3d::Zero(), normal = Vec3d::Zero();
    double height = 0.0;
};
SkinPoint closest_on_skin(const Vec3d& p, const Vec3d& facing, const TriangleSet& skin);

struct Pushed {
    std::vector<Vec3d> cvs;
    std::vector<double> push;  // of each CV, metres
    std::vector<bool> on_edge; // either closest lies on an edge
    int skipped = 0;
};
// The root, CV 0, stays: the strand is held there.
Pushed push_targets(const std::vector<Vec3d>& rest, const std::vector<Vec3d>& bent, const Vec3d& root_normal,
                    double offset_scale, const TriangleSet& skin);

} // namespace marram::oracle
