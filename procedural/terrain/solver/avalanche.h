// SPDX-License-Identifier: Apache-2.0
// Avalanches on slip faces. See avalanche.cpp for the model.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"

#include <vector>

namespace marram {

struct AvalancheSettings {
    double starts = 34.0 * degree; // static angle of repose, radians
    double stops = 33.0 * degree;  // dynamic angle of repose
    int max_sweeps = 40;           // per call
    bool operator==(const AvalancheSettings&) const = default;
};

class Avalanche {
  public:
    // `sand`: whole units, as doubles; `ground`, `height`: metres; all with rows of `pitch`. On entry and on
    // return `height` is ground + sand.
    // Returns the number of sweeps.
    int run(int rows, int columns, bool periodic, double cell, const AvalancheSettings& settings,
            const float* ground, double* sand, float* height, size_t pitch);

  private:
    WideVector<double> moves_;
};

} // namespace marram
