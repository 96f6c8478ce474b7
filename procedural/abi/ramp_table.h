// SPDX-License-Identifier: Apache-2.0
// Evaluates a ramp for eight strands at once as a sum of clamped pieces, without branching on position.
#pragma once

#include "core/math/ramp.h"
#include "core/math/simd.h"

namespace marram {

// Equals Ramp::operator() up to rounding. Cost: a few operations per knot.
MARRAM_INLINE VDouble evaluate(const Ramp& ramp, VDouble x) {
    const auto positions = ramp.positions();
    const auto values = ramp.values();
    VDouble result = splat(values[0]);
    for (size_t i = 1; i < positions.size(); ++i) {
        VDouble t = (x - positions[i - 1]) * (1.0 / (positions[i] - positions[i - 1]));
        t = vmin(vmax(t, 0.0), 1.0);
        if (ramp.interpolation() == Ramp::Interpolation::constant) t = splat(0.0);
        if (ramp.interpolation() == Ramp::Interpolation::smooth) t = t * t * (3.0 - 2.0 * t);
        result = select(x < positions[i], result + t * (values[i] - values[i - 1]), values[i]);
    }
    return result;
}

} // namespace marram
