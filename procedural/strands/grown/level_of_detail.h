// SPDX-License-Identifier: Apache-2.0
// Level of detail: where strands are narrower than the tolerance in pixels, fewer and wider ones stand for
// them (R. Cook, J. Halstead, M. Planck, D. Ryu, "Stochastic Simplification of Aggregate Detail", ACM
// Transactions on Graphics 26, 2007).
//
// SHARE. At the distance d from the camera, strands of width w are w / (p d) pixels wide, with p the angle of
// a pixel in the middle of the image. Of those narrower than tau pixels, the share s stays, so that the
// widest is tau pixels wide:
//
//     1 / W(s) = x = w / (tau p d),     s = 1 where x >= 1,     W: see below
//
// RANK. Strands vanish in the order of their ranks, from 1 down. A rank is the place in the order in which
// roots were thrown (roots.h). So those that are left are at least as far apart as all are, and else random.
//
// WIDTH. A strand is scaled by W until s comes within a fifth of its rank; from there its width shrinks to 0:
//
//     f(rank) = W                       rank <= s (1 - t)
//               W (s - rank) / (s t)    rank < s              t = min(1/5, 1 - s),    W = 1 / (s (1 - t / 2))
//
// It scales the rendered width alone: strands bend and collide with their own. w is that of the groom's widest
// strand, scaled by its mesh instance; where width_by makes strands narrower, these stay narrower than tau.
//
// The mean of f over all ranks is 1: the area that strands cover stays. f is continuous in s, and s in d. So
// nothing pops. s depends on the distance alone, not on where the camera looks.
//
// Of a camera that moves while the shutter is open, the smallest distance counts; of a mesh, its place at the
// first motion sample.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <vector>

namespace marram {

struct LevelOfDetail {
    std::vector<Vec3d> cameras; // at instants of the shutter
    double full = 0.0;          // m: w / (tau p), the distance up to which all strands stay

    // width: of the widest strand, m, above 0.
    LevelOfDetail(const MarramView& view, double width);
    double share_at(double distance) const;
    double distance_of(const Vec3d& p) const; // from the nearest of the cameras
};

// f above: 0 if the strand has vanished.
double width_factor(double rank, double share);

} // namespace marram
