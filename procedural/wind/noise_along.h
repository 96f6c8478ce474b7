// SPDX-License-Identifier: Apache-2.0
// The noise that the wind carries, along strands.
#pragma once

#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

namespace marram {

// Where the noise field is: metres that it has travelled, and its coordinate in the fourth dimension, in
// cells.
struct NoiseTime {
    double travel; // along the wind's direction
    Vec3d offset;  // and besides, if the wind has changed
    double w;
};

// One time, or the two of a loop with their weights: there, the field is blended with the field one cycle
// earlier, so that the last frame continues in the first. Dividing by the norm of the weights keeps the rms
// constant (the two fields are independent).
struct NoiseTimes {
    NoiseTime now, earlier;
    double weight_now = 1.0, weight_earlier = 0.0;
};

NoiseTimes noise_times(const Wind& wind, double frame, double fps);

// strands.values[0 ... count - 1]: the noise at these arc lengths of eight strands whose roots, for noise,
// are at noise_origin. count: at most strands.cvs.
void noise_along(const Wind& wind, const NoiseTimes& times, const Wide3d& noise_origin, const VDouble* arc,
                 int count, Strands& strands);

} // namespace marram
