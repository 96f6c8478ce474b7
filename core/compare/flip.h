// SPDX-License-Identifier: Apache-2.0
// How different two pictures look to somebody who flips between them: FLIP, after P. Andersson, J. Nilsson, T. Akenine-Moeller,
// M. Oskarsson, K. Astrom & M. Fairchild, "FLIP: A Difference Evaluator for Alternating Images" (HPG 2020), and for linear
// pictures of any range P. Andersson, J. Nilsson, P. Shirley & T. Akenine-Moeller, "Visualizing Errors in Rendered High Dynamic
// Range Images" (EGSR 2021).
//
// Colours are seen through the eye's contrast sensitivity (in YCxCz, sums of Gaussians), compared in L*a*b* by the HyAB distance, which
// suits large differences, after colours are weakened where it is dark (Hunt); a difference of edges or points makes it worse. 0: none
// is seen, 1: as different as green and blue. A pixel spans 1/67 of a degree: a monitor 0.7 m wide and away, of 3840 pixels.
//
// Linear pictures are developed (a filmic curve) at exposures between those at which the brightest and the median pixel of the
// reference are nearly white, a stop apart, and 24 of them at most, further apart then (against the paper, for the time they take); a
// pixel's difference is the greatest of these. Where the median is 0, it is that of the pixels with light. Pictures made for a display
// are compared as it shows them.
#pragma once

#include <vector>

namespace marram {

enum class Range {
    linear,  // of any range: developed at several exposures ("HDR-FLIP")
    display, // 0 ... 1 is what a display shows; what is beyond is cut off ("LDR-FLIP")
};

// Of linear colours, 3 floats a pixel, rows from the top; negative ones count as 0. One number a pixel. Cost: 3 us a pixel and exposure.
std::vector<float> flip_map(const std::vector<float>& test, const std::vector<float>& reference, int width,
                            int height, Range range = Range::linear);

} // namespace marram
