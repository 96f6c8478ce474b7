// SPDX-License-Identifier: Apache-2.0
// Binds imported strands to a surface: each to the triangle closest to its root in the bind pose.
#pragma once

#include "procedural/strands/lent_curves.h"
#include "procedural/strands/surface.h"

#include <functional>
#include <string>
#include <vector>

namespace marram {

struct RootBinding {
    Vec3d weights;     // barycentric, of the point closest to the root
    uint32_t triangle; // of the closest point
    float distance;    // from the root to the closest point, m
    float height;      // root_height() of the root, m
};

// Signed height of a root in m: its distance from the closest point, or minus its depth below the triangle's
// plane. `foot`: the closest point; `normal`: of the plane; `rounding`: depths up to this do not count.
// Beside the border of an open surface a root is neither above nor below it; the distance is used there.
inline double root_height(const Vec3d& root, const Vec3d& foot, const Vec3d& normal, double rounding) {
    const double along = (root - foot).dot(normal);
    return along < -rounding ? along : (root - foot).norm();
}

struct Binding {
    std::vector<RootBinding> root_bindings; // [curve]
    double rounding = 0.0;                  // m: roots less deep than this count as on the surface
    // Greatest and mean distance of the roots from the surface, m; depth of the deepest root, m; number of
    // roots farther away than a tenth of their strand's length; number of roots below the surface; number of
    // strands without length.
    double greatest_distance = 0.0, mean_distance = 0.0, deepest = 0.0;
    uint64_t far = 0, inside = 0, no_length = 0;
    uint64_t reversed =
        0; // of `far`: number of strands that end on the surface, within a tenth of their length
};

// `vertices`: of the curves in the bind pose. `bind` must have a triangle with an area. Of equally close
// triangles, the one that faces the root most is chosen. Bit-identical at any thread count. Cost: 1 us per
// strand plus 30 ns per triangle. The result is incomplete once cancelled() is true.
Binding bind_strands(const LentCurves& curves, const float* vertices, const Surface& bind,
                     uint32_t vertex_count, const std::function<bool()>& cancelled);

// What is wrong with where most roots are, if anything: strands that run from tip to root, or lie far from
// the surface.
struct RootProblem {
    std::string id, what, fix; // id: "far" or "reversed"; "": nothing is wrong
};
// kind: "strands"; mesh: the surface's name.
RootProblem root_problem(const Binding& binding, const std::string& kind, const std::string& mesh);

// Sum of the lengths of a curve's segments; vertices: of its CVs.
double curve_length(const float* vertices, uint32_t cvs);

} // namespace marram
