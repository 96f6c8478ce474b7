// SPDX-License-Identifier: Apache-2.0
// Past poses of the skin at the knots of the jiggle's window.
#pragma once

#include "procedural/groom/surface.h"
#include "procedural/wind/jiggle.h"

namespace marram {

struct PastSkin {
    struct Pose {
        std::vector<float> positions, normals; // normals: empty if the mesh is faceted
    };
    JiggleWindow window;
    std::vector<Pose> poses;       // without consecutive duplicates
    std::vector<uint32_t> of_knot; // [knot of the window] -> poses

    // True if the pose equals that of the previous knot.
    bool rests_at(int64_t knot) const {
        const auto at = size_t(knot - window.first);
        return at > 0 && of_knot[at] == of_knot[at - 1];
    }
    bool moves() const { return poses.size() > 1; }
    size_t bytes() const;
    Surface at(int64_t knot, const MarramMesh& mesh) const;
};

// Gets the skin's poses from the renderer over the window that the frame's motion samples need. `length`:
// upper bound of strand lengths, m. `travel`: of the skin's instances, by find_travel(), m. Memory: 12 bytes
// per vertex (24 with normals) for each knot at which the skin differs from the knot before.
MarramStatus read_past(const MarramFrame& frame, uint32_t mesh, const Jiggle& jiggle, double length,
                       PastSkin& past, double travel = 0.0);

} // namespace marram
