// SPDX-License-Identifier: Apache-2.0
// Past poses of the skin at the samples of the jiggle's window.
#pragma once

#include "procedural/strands/surface.h"
#include "procedural/wind/jiggle.h"

#include <cstdint>
#include <functional>
#include <vector>

namespace marram {

struct PastSkin {
    struct Pose {
        std::vector<float> positions, normals; // normals: empty if the mesh is faceted
    };
    JiggleWindow window;
    std::vector<Pose> poses;              // without consecutive duplicates
    std::vector<uint32_t> pose_of_sample; // [past sample of the window] -> poses

    // True if the pose equals that of the previous sample.
    bool unchanged_at(int64_t past_sample) const {
        const auto at = size_t(past_sample - window.first);
        return at > 0 && pose_of_sample[at] == pose_of_sample[at - 1];
    }
    bool moves() const { return poses.size() > 1; }
    size_t bytes() const;
    Surface at(int64_t past_sample, const MarramMesh& mesh) const;
};

// Gets the skin's poses from the renderer over the window that the frame's motion samples need. `length`:
// upper bound of strand lengths, m. `travel`: of the skin's instances, by measure_travel(), m. Memory: 12
// bytes per vertex (24 with normals) for each past sample at which the skin differs from the one before.
// `announce` gets the number of past samples before they are read, which may take long.
PastSkin read_past(const MarramFrame& frame, uint32_t mesh, const Jiggle& jiggle, double length,
                   double travel, const std::function<void(int64_t)>& announce);

} // namespace marram
