// SPDX-License-Identifier: Apache-2.0
// Curve wind: the talk's basic node. See bend.cpp for the derivation.
#pragma once

#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

namespace marram {

// strands.rest -> strands.pose at `frame`, turned by strands.envelope. Computed in double, rounded once a CV.
//
// Lengths: each stored segment is as long as its rest segment to 1.74 ulp of the largest coordinate + 1e-14 relative (both
// ends are rounded once).
// A strand whose factors are 0 up to CV k has pose[0 ... k] equal to rest bit for bit.
// Cost: O(cvs) a strand; about 40 ns a CV with one octave of noise.
void bend(const Wind& wind, double frame, double fps, Strands& strands);

} // namespace marram
