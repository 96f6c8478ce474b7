// SPDX-License-Identifier: Apache-2.0
// Curve wind: the basic node of the talk. See bend.cpp for the derivation.
#pragma once

#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

namespace marram {

// strands.rest -> strands.pose at `frame`, scaled by strands.envelope. `wind`: at the frame (wind_at()).
// Computed in double, rounded once a CV.
//
// Lengths: a stored segment is as long as its rest segment to 1.74 ulp of the largest coordinate + 1e-14
// relative (both ends are rounded once). If a strand's factors are 0 up to CV k, pose[0 ... k] equals rest
// bit for bit. Cost: O(cvs) a strand; about 40 ns a CV with one octave of noise.
void bend(const Wind& wind, double frame, double fps, Strands& strands);

} // namespace marram
