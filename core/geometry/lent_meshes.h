// SPDX-License-Identifier: Apache-2.0
// Meshes as the contract lends them to procedurals.
#pragma once

#include "core/geometry/build.h"

#include <vector>

namespace marram {

// The world's meshes as the contract lists them, at the times of one procedural's motion keys. Meshes that move and have others
// themselves are posed anew for it: a drawn one is no farther off than the tolerance.
class LentMeshes {
  public:
    LentMeshes(const World& world, const SceneGeometry& geometry, std::vector<double> times);
    LentMeshes(const LentMeshes&) = delete;
    LentMeshes& operator=(const LentMeshes&) = delete;
    MarramFrame frame(const BuildSettings& settings, bool colliders);

  private:
    struct Lists {
        std::vector<const float*> positions, normals;
    };

    static MarramStatus pose(void* user, uint32_t index, double frame, float* positions, float* normals);

    const World& world_;
    const SceneGeometry& geometry_;
    std::vector<double> times_;
    std::vector<Lists> lists_;
    std::vector<std::vector<Vec3f>> posed_; // what lists_ points to beside the world
    std::vector<MarramMesh> meshes_;
};

} // namespace marram
