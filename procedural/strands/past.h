// SPDX-License-Identifier: Apache-2.0
// Past poses of the skin at the samples of the jiggle's window.
#pragma once

#include "procedural/strands/surface.h"
#include "procedural/wind/jiggle.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace marram {

struct PastSkin {
    struct Pose {
        std::vector<float> positions, normals; // normals: empty if the mesh is faceted
    };
    JiggleWindow window;
    std::vector<std::shared_ptr<const Pose>> poses; // without consecutive duplicates
    std::vector<uint32_t> pose_of_sample;           // [past sample of the window] -> poses

    bool same_at(int64_t a, int64_t b) const {
        return pose_of_sample[size_t(a - window.first)] == pose_of_sample[size_t(b - window.first)];
    }
    bool moves() const { return poses.size() > 1; }
    size_t bytes() const;
    Surface at(int64_t past_sample, const MarramMesh& mesh) const;
};

// True: the mesh has other poses at other times.
inline bool has_a_past(const MarramMesh& mesh) { return mesh.moves != 0 || mesh.time_count > 1; }

// Gets the skin's poses from the renderer over the window that the frame's motion samples need. `length`:
// upper bound of strand lengths, m. `travel`: of the skin's instances, by measure_travel(), m. Memory: 12
// bytes per vertex (24 with normals) for each past sample at which the skin differs from the one before; a
// skin that never moves is read once. `announce` gets the number of past samples before they are read, which
// may take long. `earlier`: what an earlier frame has read of the same mesh with the same step; its poses
// are not read again.
PastSkin read_past(const MarramFrame& frame, uint32_t mesh, const Jiggle& jiggle, double length,
                   double travel, const PastSkin& earlier, const std::function<void(int64_t)>& announce);

} // namespace marram
