// SPDX-License-Identifier: Apache-2.0
// The chain of rigid pieces and hinges that stands for a strand in elastica.cpp. Eight strands side by side.
#pragma once

#include "core/math/simd.h"

#include <span>

namespace marram {

// A segment at rest. Lengths in strand lengths, loads in rigidity / length^3.
struct ElasticaSegment {
    VFloat length, rigidity; // rigidity: at its start
    VFloat kink_x, kink_y;   // rest turn at its start: tan(angle / 4) towards e1, e2 of the frame before
    VFloat drag, weight;
    Wide3f wind;
    Wide3f e1, e2, t; // frame, turned from segment to segment without twist
};

// A piece and the hinge at its start.
struct ElasticaJoint {
    VFloat compliance, skew, spread; // of the hinge
    VFloat bend_x, bend_y;           // tan(angle / 2) of its turn, towards e1 and e2
    // tan(angle / 2) about the tangent, of this pose and of the next; 0 but at kinks, see elastica_add_kink()
    VFloat twist, next_twist;
    // Twice the moment that it has at rest, see ElasticaHinge; 0 unless it hangs
    VFloat rest_x, rest_y, rest_z;
    VFloat best_x, best_y;     // the bend after which a step was smallest
    VFloat qx, qy, qz, scale;  // kink and bend: (x, y, z, w) = (-qy, qx, 0, qz) over its length; 2 / length^2
    VFloat spin_cos, spin_sin; // at a CV: the turn about the tangent behind it
    VFloat flat, twist_x, twist_y; // derivatives of turns, see elastica_frames()
    Wide3f e1, e2, t;              // frame of the piece
    VFloat xx, xy, yx, yy;         // response to the turn of the piece before,
    VFloat xt, yt;                 // to its twist,
    VFloat x0, y0;                 // and to the error of the present pose
};

struct ElasticaChain {
    const ElasticaSegment* segments;
    ElasticaJoint* joints;
    int last, pieces; // number of segments; pieces of each
    float per_piece;  // 1 / pieces
};

struct ElasticaLoads {
    VInt idle;     // no loads, or no length
    VFloat number; // (drag speed^2 + |weight|) length^3 / rigidity
    VFloat length; // metres
    bool hangs;    // at rest the weight acts already
};

// Finds the bends under the loads: of the first chain, which has one piece a segment, from rest, of each
// other one from those of the one before, whose pieces it divides. `stop2`: square of the last step's largest
// turn; of the first of three chains it may be larger. `done`: idle, or converged on the last; `half_done`:
// on the one before.
void elastica_solve(std::span<const ElasticaChain> chains, const ElasticaLoads& loads, const VFloat& stop2,
                    VInt& done, VInt& half_done);

struct ElasticaFrame {
    Wide3f e1, e2, t;
};

MARRAM_INLINE bool elastica_any(VInt mask) {
    const Long4 bits = (Long4)mask;
    return ((bits[0] | bits[1]) | (bits[2] | bits[3])) != 0;
}

MARRAM_INLINE Wide3f elastica_select(VInt mask, const Wide3f& a, const Wide3f& b) {
    return {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
}

MARRAM_INLINE VFloat elastica_abs(VFloat x) { return (VFloat)((VInt)x & 0x7fffffff); }

// a / b, 0 where b is not positive
MARRAM_INLINE VFloat elastica_ratio(VFloat a, VFloat b) {
    const VFloat zero{};
    return b > zero ? a / b : zero;
}

// Turns a frame towards (x, y) by the angle 2 atan(|(x, y)| / z), without twist. scale = 2 / (x^2 + y^2 +
// z^2)
MARRAM_INLINE void elastica_turn(ElasticaFrame& f, VFloat x, VFloat y, VFloat z, VFloat scale) {
    const Wide3f axis = f.e1 * x + f.e2 * y + f.t * z;
    f.e1 = f.e1 - axis * (scale * x);
    f.e2 = f.e2 - axis * (scale * y);
    f.t = axis * (scale * z) - f.t;
}

} // namespace marram
