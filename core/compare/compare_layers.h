// SPDX-License-Identifier: Apache-2.0
// Compares a layer of two pictures: its values, and for layers other than the picture proper whether they are
// alike (criteria in core/compare/compare.h).
#pragma once

#include "core/compare/compare.h"

namespace marram {

// Both have the same channels in the same order, and width * height pixels. same_samples: a pixel, as far
// as is known.
LayerResult compare_layer(const Picture::Layer& a, const Picture::Layer& b, int width, int height,
                          bool same_samples);

} // namespace marram
