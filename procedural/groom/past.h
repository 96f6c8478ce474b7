// SPDX-License-Identifier: Apache-2.0
// Where the skin was: its poses at the knots that jiggle looks back to.
#pragma once

#include "procedural/groom/surface.h"
#include "procedural/wind/jiggle.h"

namespace marram {

struct PastSkin {
    struct Pose {
        std::vector<float> positions, normals; // normals empty where the mesh is facetted
    };
    JiggleWindow window;
    std::vector<Pose> poses;       // each once, however long the skin rested in it
    std::vector<uint32_t> of_knot; // [knot of the window] -> poses

    // The same as at the knot before.
    bool rests_at(int64_t knot) const {
        const auto at = size_t(knot - window.first);
        return at > 0 && of_knot[at] == of_knot[at - 1];
    }
    bool moves() const { return poses.size() > 1; }
    size_t bytes() const;
    Surface at(int64_t knot, const MarramMesh& mesh) const;
};

// Asks the renderer for the skin's poses over the window that the frame's motion samples need. `length`: no strand is longer. `travel`: of
// instances of the skin, find_travel().
// Memory: 12 bytes a vertex (24 with normals) for each knot at which the skin stood elsewhere than at the knot before.
MarramStatus read_past(const MarramFrame& frame, uint32_t mesh, const Jiggle& jiggle, double length,
                       PastSkin& past, double travel = 0.0);

} // namespace marram
