// SPDX-License-Identifier: Apache-2.0
// FLIP: the perceived difference of two pictures when flipping between them, after P. Andersson, J. Nilsson,
// T. Akenine-Moeller, M. Oskarsson, K. Astrom & M. Fairchild, "FLIP: A Difference Evaluator for Alternating
// Images" (HPG 2020). For HDR pictures: P. Andersson, J. Nilsson, P. Shirley & T. Akenine-Moeller,
// "Visualizing Errors in Rendered High Dynamic Range Images" (EGSR 2021).
//
// Colours are filtered by the contrast sensitivity functions of the eye (sums of Gaussians, in YCxCz),
// adjusted for the Hunt effect (colours look weaker in the dark), and compared in L*a*b* by the HyAB
// distance, which suits large differences. Differences of edges and points increase the result. 0: no visible
// difference, 1: as different as green and blue. 67 pixels per degree: a monitor 0.7 m wide, at 0.7 m
// distance, with 3840 pixels.
//
// Linear pictures are tone-mapped (a filmic curve) at several exposures. The first makes the brightest pixel
// of the reference nearly white, the last its median pixel. They are a stop apart; beyond 24 exposures the
// step is greater (unlike the paper, to limit the time). A pixel's result is the maximum over the exposures.
// If the median is 0, the median of the pixels with light is used. Display-encoded pictures are compared as
// displayed.
#pragma once

#include <vector>

namespace marram {

enum class Range {
    linear,  // HDR: tone-mapped at several exposures ("HDR-FLIP")
    display, // 0 ... 1 is the display range; clamped ("LDR-FLIP")
};

// Input: linear colours, 3 floats a pixel, rows from the top; negative values count as 0. Output: one value a
// pixel. Cost: 3 us a pixel and exposure.
std::vector<float> flip_map(const std::vector<float>& test, const std::vector<float>& reference, int width,
                            int height, Range range = Range::linear);

} // namespace marram
