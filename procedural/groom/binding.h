// SPDX-License-Identifier: Apache-2.0
// Strands that were groomed elsewhere, bound to a surface: each to the triangle that is nearest to its root in the bind pose.
#pragma once

#include "procedural/groom/lent_curves.h"
#include "procedural/groom/surface.h"

#include <functional>
#include <vector>

namespace marram {

struct Bond {
    Vec3d weights;     // barycentric, of the point of the surface that is nearest to the root
    uint32_t triangle; // it is in
    float distance;    // of the root from that point, m
    float height;      // of the root, m: above the triangle's plane its distance, under it how far, negative
};

// Height of a root, as above. `foot`: the nearest point; `normal`: the plane's; `rounding`: what of a depth is none. Beside the border of an
// open surface a root is far away, and yet not above or under it.
inline double root_height(const Vec3d& root, const Vec3d& foot, const Vec3d& normal, double rounding) {
    const double along = (root - foot).dot(normal);
    return along < -rounding ? along : (root - foot).norm();
}

struct Binding {
    std::vector<Bond> bonds; // [curve]
    double rounding = 0.0;   // m: a root that is less under the surface is on it
    // How strands stand: the greatest distance of a root and its mean, m; roots farther from the surface than a tenth of their
    // strand's length; roots under the surface, and how deep the deepest is, m; strands without length.
    double greatest_distance = 0.0, mean_distance = 0.0, deepest = 0.0;
    uint64_t far = 0, inside = 0, no_length = 0;
};

// `vertices`: of the curves in the bind pose. `bind` has a triangle with an area. Of several triangles as near the one that faces the
// root most. The same bits at any thread count. Cost: 1 us a strand, and 30 ns a triangle. Incomplete once cancelled() is true.
Binding bind_strands(const LentCurves& curves, const float* vertices, const Surface& bind,
                     uint32_t vertex_count, const std::function<bool()>& cancelled);

// Sum of the lengths of a curve's segments; vertices: of its CVs.
double curve_length(const float* vertices, uint32_t cvs);

} // namespace marram
