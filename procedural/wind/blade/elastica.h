// SPDX-License-Identifier: Apache-2.0
// The static pose of blades under wind and weight: an elastica in space. See elastica.cpp for the derivation.
#pragma once

#include "procedural/wind/blade/elastica_chain.h"

namespace marram {

// Eight strands side by side. All pointers are to arrays along the strand, root first. Values are finite.
struct ElasticaBlock {
    int cvs = 0;                         // at least 2
    int pieces = 1;                      // parts of a segment, a power of two: elastica_pieces()
    const Wide3f* rest = nullptr;        // [cvs], metres. The shape without loads
    const Wide3f* rest_normal = nullptr; // [cvs], or nullptr
    Wide3f* pose = nullptr;              // [cvs], out
    Wide3f* pose_normal = nullptr;       // [cvs], out, if rest_normal
    const VFloat* rigidity = nullptr;    // [cvs], N m^2, at least 0. Linear in between
    const VFloat* drag = nullptr;        // [cvs - 1], 1/2 rho Cd width, kg/m^2
    const VFloat* weight = nullptr;      // [cvs - 1], N/m along -y. Negative: buoyant
    const Wide3f* wind = nullptr;        // [cvs - 1], m/s at the middle of each segment
    double tolerance = 1e-3;             // metres: error allowed to Newton's method
    bool hangs = false;                  // rest is the shape under weight, without wind
};

struct ElasticaScratch {
    WideVector<ElasticaSegment> segments;
    WideVector<ElasticaJoint> joints; // of all chains
};

// Poses the block. Returns a bit for each lane that did not converge: those hold the pose whose next step was
// smallest. A strand's pose has the same bits in any lane, beside any others.
//
// - Without loads on a strand its pose is its rest, bit for bit.
// - Segments keep their lengths: to 1e-14 relative before the CVs are rounded to float.
// - A rigidity below load length^3 / 10^6 is raised to that: a boundary layer of length / 100 is invisible.
// - Coincident CVs are allowed; a strand without length is copied.
unsigned elastica(const ElasticaBlock& block, ElasticaScratch& scratch);

// The pieces that a segment needs for errors below `tolerance` (in strand lengths) on 99 % of the strands.
// `cauchy`, `weight`: the greatest drag speed^2 and |weight|, each times length^3 / rigidity. Measured: see
// elastica.cpp. Take one number for a whole groom, from its longest strand and strongest wind, and keep it
// over time: a strand whose number of pieces changes jumps by the error.
int elastica_pieces(int cvs, double cauchy, double weight, double tolerance);

} // namespace marram
