// SPDX-License-Identifier: Apache-2.0
// The renderer's colliders at one instant: its Embree scene for rays, the mesh tables of the contract for exact corners, and a
// tree over these for the triangles near a place.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/wind/collider_tree.h"

#include <array>
#include <limits>
#include <span>
#include <vector>

namespace marram {

struct Colliders {
    RTCScene scene = nullptr;
    const MarramMesh* lent = nullptr;         // the frame's meshes
    std::vector<const MarramMesh*> meshes;    // [geometry ID]; nullptr: not lent
    uint32_t time_index = 0;                  // motion sample
    float time = 0.0F;                        // the same in [0, 1], as Embree counts it
    std::shared_ptr<const ColliderTree> tree; // for exact collision and offset scale

    bool any() const { return scene != nullptr && !meshes.empty(); }
    const MarramMesh* mesh_of(unsigned geometry) const {
        return geometry < meshes.size() ? meshes[geometry] : nullptr;
    }
    const float* corner(const MarramMesh& mesh, unsigned triangle, size_t i) const {
        const float* positions = mesh.positions[mesh.time_count > 1 ? time_index : 0];
        return positions + 3 * size_t(mesh.triangles[3 * size_t(triangle) + i]);
    }
    std::array<Vec3d, 3> corners(const MarramMesh& mesh, unsigned triangle) const {
        std::array<Vec3d, 3> p;
        for (size_t i = 0; i < 3; ++i) {
            const float* v = corner(mesh, triangle, i);
            p[i] = {double(v[0]), double(v[1]), double(v[2])};
        }
        return p;
    }
};

// The colliders of a frame at its motion sample `time_index`; empty where the frame lends none. Without a tree.
Colliders colliders_at(const MarramFrame& frame, uint32_t time_index);

inline Eigen::AlignedBox3d everywhere() { return {Vec3d::Constant(-infinity), Vec3d::Constant(infinity)}; }

// The trees of a frame, kept for the next: where neither the meshes nor the reach have changed they serve again. A hash of
// all that the meshes hold tells (XXH3, 128 bits): 36 ms a gigabyte on two threads, a thirtieth of the making.
class ColliderTrees {
  public:
    // Gives the colliders of a frame's motion samples their trees, over the triangles that touch `reach`; all samples share
    // one where no mesh moves. Strands outside of the reach are not to be collided. Returns whether they had to be made.
    bool give(const MarramFrame& frame, const Eigen::AlignedBox3d& reach,
              std::span<Colliders* const> colliders);

    size_t bytes() const;

  private:
    std::vector<uint64_t> key_;                              // of what the trees were made from
    std::vector<std::shared_ptr<const ColliderTree>> trees_; // [colliders], or one where no mesh moves
};

// The point of triangle p nearest to q: C. Ericson, "Real-Time Collision Detection", 5.1.5, by the Voronoi regions; a triangle
// without area is the longest of its edges.
Vec3d nearest_point(const std::array<Vec3d, 3>& p, const Vec3d& q);

} // namespace marram
