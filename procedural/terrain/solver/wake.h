// SPDX-License-Identifier: Apache-2.0
// Wakes: the wind recovers behind plants. See wake.cpp for the model.
#pragma once

#include "core/math/simd.h"
#include "procedural/air/downwind_rays.h"

namespace marram {

// Plants, per cell; rows of `pitch`.
struct WakePlants {
    const float* frontal_area = nullptr; // per area of ground
    const double* height = nullptr;      // metres; NULL: full_height everywhere
    double full_height = 1.0;            // metres
    double drag = 16.0;                  // stress is divided by 1 + drag * frontal_area
};

class Wake {
  public:
    // `recovery`: length over which the wind recovers to 1/e, in plant heights; > 0. `deficit`: the fraction
    // of the shear velocity that is missing in and behind plants, 0 to 1.
    void find(const DownwindGrid& grid, double recovery, const WakePlants& plants, size_t pitch,
              float* deficit);

  private:
    WideVector<float> own_, decay_, rays_;
};

} // namespace marram
