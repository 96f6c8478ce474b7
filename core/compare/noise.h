// SPDX-License-Identifier: Apache-2.0
// Whether noise explains the differences of two pictures, from the variance of their pixels' means; and which
// differences noise could hide. The tests and their limits: core/compare/compare.h.
#pragma once

#include "core/compare/compare.h"

namespace marram {

// The variance of the difference of two pictures: 3 floats a pixel. limits: of a golden frame, whose variance
// is that of the difference already. Empty if noise is unknown; result.unknown then says why.
std::vector<float> variance_of_difference(const Picture& test, const Picture& reference,
                                          const std::optional<Limits>& limits, Comparison& result);

// Fills result.scales and, without limits, result.ratios, and reports those that fail. a, b: colours, 3
// floats a pixel, as variance.
void judge_noise(const Picture& test, const Picture& reference, const std::vector<float>& a,
                 const std::vector<float>& b, const std::vector<float>& variance,
                 const std::optional<Limits>& limits, Comparison& result);

// The reference plus a difference that the ratio test of squares of this size finds in half of all cases:
// each square is brighter or darker by `times` the standard deviation of its mean.
std::vector<float> with_hidden_difference(const std::vector<float>& reference,
                                          const std::vector<float>& variance, int size, double times,
                                          int width, int height);

} // namespace marram
