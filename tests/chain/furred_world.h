// SPDX-License-Identifier: Apache-2.0
// Meshes in an Embree scene of their own and strands that grow on one of them: the data that a renderer
// passes to the chain, so that a stage can be tested alone.
#pragma once

#include "core/geometry/mesh.h"
#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/grown/roots.h"
#include "procedural/strands/grown/strand_shape.h"
#include "procedural/wind/chain.h"

#include <memory>
#include <string>
#include <vector>

namespace marram {

// Meshes and their Embree scene, with all data that collide() needs.
class FurredWorld {
  public:
    using Positions = std::vector<Vec3f>;
    // later: [mesh][motion sample from the second on], for deforming meshes; all have the same number of
    // samples, or none.
    explicit FurredWorld(std::vector<Mesh> meshes, std::vector<std::vector<Positions>> later = {});
    ~FurredWorld();
    FurredWorld(const FurredWorld&) = delete;
    FurredWorld& operator=(const FurredWorld&) = delete;

    const MarramFrame& frame() const { return frame_; }
    const MarramMesh& mesh(size_t i) const { return lent_[i]; }
    Surface surface(size_t i, uint32_t time = 0) const;
    Colliders colliders() const {
        Colliders colliders = colliders_at(frame_, 0);
        ColliderTrees().build_or_reuse(frame_, everywhere(), std::array{&colliders});
        return colliders;
    }

  private:
    std::vector<Mesh> meshes_;
    std::vector<std::vector<Positions>> later_;
    std::vector<std::vector<const float*>> pointers_; // [mesh][motion sample]
    std::vector<MarramMesh> lent_;
    std::vector<std::string> names_;
    MarramFrame frame_{};
    std::vector<double> times_;
};

// A plain coat: `count` strands of `cvs` CVs on mesh 0, lengths in a range, leaning and curved a little.
Groom plain_coat(uint64_t count, int cvs, double shortest, double longest, double width);

// All strands of the groom in patches of at most 512, at rest on the surface. On a deformed surface: the
// strands of `bind`.
std::vector<Strands> grow(const Groom& groom, const Wind& wind, const SkinPoses& poses,
                          size_t most = SIZE_MAX);
inline std::vector<Strands> grow(const Groom& groom, const Wind& wind, const Surface& surface,
                                 size_t most = SIZE_MAX) {
    return grow(groom, wind, SkinPoses{surface, surface}, most);
}

// A steady wind along `direction` with two octaves of noise.
Wind plain_wind(const Vec3d& direction, double global_rotate);

} // namespace marram
