// SPDX-License-Identifier: Apache-2.0
// Flow separation: bubbles behind brinks and in front of steep faces. See separation.cpp for the model.
#pragma once

#include "core/math/simd.h"
#include "procedural/air/downwind_rays.h"

namespace marram {

struct SeparationSettings {
    double steepest = 0.36397; // tangent: steeper faces cause a bubble (20 degrees)
    double lee = 0.25;         // steepest descent of a separated streamline (14 degrees)
    double windward = 0.36397; // steepest ascent of one in front of a face
    double convergence = 0.0;  // tangent of the angle at which both sides of a bubble close in; 0: not at all
    bool operator==(const SeparationSettings&) const = default;
};

// Computes `excess`, the height of each bubble's bounding streamline above the ground (metres, 0 without a
// bubble). `height`, `excess`: rows of `pitch` floats. `range`: highest minus lowest height.
class Separation {
  public:
    void find(const DownwindGrid& course, const SeparationSettings& settings, const float* height,
              double range, size_t pitch, float* excess);

  private:
    WideVector<float> rays_, front_rays_; // front_rays_: in front of faces; only with convergence
};

} // namespace marram
