// SPDX-License-Identifier: Apache-2.0
// A layer of two pictures: its numbers, and whether a layer other than the picture proper is alike (core/compare/compare.h says when).
#pragma once

#include "core/compare/compare.h"

namespace marram {

// Both have the same channels in the same order, and width * height pixels.
LayerResult compare_layer(const Picture::Layer& a, const Picture::Layer& b, int width, int height);

} // namespace marram
