// SPDX-License-Identifier: Apache-2.0
// A field of the wind of each shape around the origin, 18 m wide, for the benchmark of its cost.
#pragma once

#include "procedural/wind/field/placed_field.h"

namespace marram::bench {

PlacedField whirl_field();
// Of 128 x 64 x 128 voxels (12.6 MB a frame); `frames` of them, frame 1 first.
PlacedField grid_field(int frames, bool staggered);
PlacedField image_field(); // of 1024 x 1024 pixels
PlacedField curves_field();

} // namespace marram::bench
