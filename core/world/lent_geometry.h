// SPDX-License-Identifier: Apache-2.0
// Geometry in the contract's form, lent to one procedural.
#pragma once

#include "core/world/build_state.h"

#include <deque>
#include <optional>
#include <vector>

namespace marram {

// The meshes and curves that a procedural depends on, at the times of its motion keys. Moving meshes with
// other motion keys are posed at these times; a rendered mesh differs from that by at most the tolerance.
class LentGeometry {
  public:
    LentGeometry(Build& build, Procedural& to, std::vector<double> times);
    LentGeometry(const LentGeometry&) = delete;
    LentGeometry& operator=(const LentGeometry&) = delete;
    const MarramFrame& frame() const { return frame_; }

  private:
    struct Lists {
        std::vector<const float*> positions, normals;
        std::vector<MarramAttribute> attributes;
        std::vector<MarramGrid> grids;
    };

    void lend_mesh(Build& build, uint32_t id);
    void lend_curves(const Build& build, const std::string& name);
    PosedMesh posed(uint32_t index, double frame, bool with_normals) const;
    static MarramStatus pose(void* user, uint32_t index, double frame, float* positions, float* normals);
    static MarramStatus instance_transform(void* user, uint32_t index, double frame, double* matrix);
    static MarramStatus pose_curves(void* user, uint32_t index, double frame, uint64_t first, uint64_t count,
                                    float* vertices);

    const SceneGeometry& geometry_;
    Procedural& to_;
    std::vector<double> times_;
    std::vector<Lists> lists_;
    std::vector<std::vector<Vec3f>> posed_; // data of lists_ that is not in the world
    std::deque<std::vector<float>> blended_;
    std::vector<MarramMesh> meshes_;
    std::vector<Procedural*> makers_; // [meshes_] of those that procedurals have made, else nullptr
    std::vector<MarramCurves> curves_;
    MarramFrame frame_{};
    std::optional<CameraSamples> camera_; // of view_
    MarramView view_{};
};

} // namespace marram
