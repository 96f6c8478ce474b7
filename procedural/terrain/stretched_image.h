// SPDX-License-Identifier: Apache-2.0
// An image stretched over a terrain: its border is the terrain's border.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/terrain/fields.h"

#include <vector>

namespace marram {

class StretchedImage {
  public:
    StretchedImage() = default;
    // Keeps the first `components` channels.
    StretchedImage(const MarramGrid& grid, const Domain& domain, int components = 1);
    // Bilinear value of a channel at a sample of the terrain. Pixel centres are half a pixel inside.
    double at(int i, int j, int channel = 0) const;

  private:
    std::vector<float> pixels_;
    int nx_ = 0, nz_ = 0, components_ = 1, samples_x_ = 1, samples_z_ = 1;
};

} // namespace marram
