// SPDX-License-Identifier: Apache-2.0
// Avalanches on slip faces. The page is in avalanche.cpp.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"

#include <vector>

namespace marram {

struct AvalancheSettings {
    double starts = 34.0 * degree; // static angle of repose, radians
    double stops = 33.0 * degree;  // dynamic angle of repose
    int most_sweeps = 40;          // a call
    bool operator==(const AvalancheSettings&) const = default;
};

class Avalanche {
  public:
    // `sand`: whole units, as doubles; `ground`, `height`: metres; all rows of `pitch`. `height` is ground + sand, before and after.
    // Returns the number of sweeps.
    int run(int rows, int columns, bool periodic, double cell, const AvalancheSettings& settings,
            const float* ground, double* sand, float* height, size_t pitch);

  private:
    WideVector<double> moves_;
};

} // namespace marram
