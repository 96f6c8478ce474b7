// SPDX-License-Identifier: Apache-2.0
// Exact orientation predicate: on which side of a plane a point lies.
//
// The sign of det(b - a, c - a, d - a) is first evaluated in doubles; Shewchuk ("Adaptive Precision
// Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997) bounds the rounding error by (7 + 56
// e) e times the sum of the products' magnitudes, e = 2^-53. If the value is within that bound, the
// determinant is summed again as an expansion, without rounding. Exact as long as products of three
// coordinate differences neither overflow nor lose bits below the smallest double: differences between 1e-85
// and 1e100, or 0.
#pragma once

#include "core/math/vec.h"

namespace marram::oracle {

// +1: d lies on the side of the plane a, b, c to which (b - a) x (c - a) points; -1: on the other; 0: exactly
// in it.
int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

} // namespace marram::oracle
