// SPDX-License-Identifier: Apache-2.0
// The faces of the mesh that stand in the sand, found on lines along the wind. The model is documented in
// ruin.cpp.
#pragma once

#include "procedural/terrain/fields.h"
#include "procedural/terrain/ruin/ruin_mesh.h"

#include <vector>

namespace marram {

inline constexpr double ruin_most_height = 30.0; // m

// A face on one line. s, ground (of the sand at its foot) and top are in metres; `cosine` is that of the
// angle between the wind and its horizontal normal. `height` starts as top - ground and becomes the effective
// H.
struct RuinFace {
    double s = 0.0, ground = 0.0, top = 0.0, cosine = 1.0;
    double height = 0.0;              // m
    double width = 0.0, to_end = 0.0; // m: width of the wall; distance to its nearer end
    double thickness = 0.0;           // m: of the solid behind (windward) or in front (lee)
    int line = 0;
};

// The faces on one line, both kinds sorted by s.
struct RuinLine {
    std::vector<RuinFace> windward, lee;
};

struct RuinLines {
    double first = 0.0, step = 1.0; // line l is at t = first + l step
    std::vector<RuinLine> lines;
};

// Traces the lines and returns their faces, with effective H and the size of their walls. `below`: the
// terrain without the layer. Cost: one ray for each line and height, in parallel, and 7 for each face. Same
// bits at any thread count.
RuinLines ruin_find_faces(const RuinMesh& mesh, const Domain& domain, const Fields& below);

} // namespace marram
