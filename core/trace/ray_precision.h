// SPDX-License-Identifier: Apache-2.0
// Limits of float rays, shared by hit.cpp and spawn.cpp only.
#pragma once

namespace marram {

inline constexpr double float_step = 0x1p-23; // U: relative precision of float coordinates
// A ray at a smaller angle to the fibre, 1 in 1e8, may hit it again.
inline constexpr double min_sine = 1e-4;

} // namespace marram
