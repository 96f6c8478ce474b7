// SPDX-License-Identifier: Apache-2.0
// The colliders at one time: the renderer's Embree scene for rays, the mesh tables of the plugin interface
// for exact corners, and a tree over these for queries of nearby triangles.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/wind/collision/collider_tree.h"

#include <array>
#include <limits>
#include <span>
#include <vector>

namespace marram {

struct Colliders {
    RTCScene scene = nullptr;
    const MarramMesh* lent = nullptr;         // the frame's meshes
    std::vector<const MarramMesh*> meshes;    // [geometry ID]; nullptr: not in the frame
    uint32_t time_index = 0;                  // motion sample
    float time = 0.0F;                        // the same as an Embree ray time, in [0, 1]
    std::shared_ptr<const ColliderTree> tree; // for exact collision and offset scale

    bool any() const { return scene != nullptr && !meshes.empty(); }
    const MarramMesh* mesh_of(unsigned geometry) const {
        return geometry < meshes.size() ? meshes[geometry] : nullptr;
    }
    // The lent mesh that a ray hit; nullptr if it hit nothing, an instance, or a triangle that was not lent.
    const MarramMesh* mesh_of(const RTCHit& hit) const {
        const MarramMesh* mesh =
            hit.geomID == RTC_INVALID_GEOMETRY_ID || hit.instID[0] != RTC_INVALID_GEOMETRY_ID
                ? nullptr
                : mesh_of(hit.geomID);
        return mesh && hit.primID < mesh->triangle_count ? mesh : nullptr;
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

// The colliders of a frame at motion sample `time_index`, without a tree; empty if the frame has none.
Colliders colliders_at(const MarramFrame& frame, uint32_t time_index);

inline Eigen::AlignedBox3d everywhere() { return {Vec3d::Constant(-infinity), Vec3d::Constant(infinity)}; }

// The trees of a frame, kept for the next one: they are reused if neither the meshes nor the query bounds
// have changed. This is detected by a hash of all mesh data (XXH3, 128 bits): 36 ms a gigabyte on two
// threads, a thirtieth of the build time.
class ColliderTrees {
  public:
    // Assigns trees over the triangles that touch `query_bounds` to the colliders of a frame's motion
    // samples; all samples share one tree if no mesh moves. Strands outside them must not be collided.
    // Returns true if the trees were built, false if they were reused.
    bool build_or_reuse(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds,
                        std::span<Colliders* const> colliders);

    size_t bytes() const;

  private:
    std::vector<uint64_t> key_; // identifies the data that the trees were built from
    std::vector<std::shared_ptr<const ColliderTree>> trees_; // [colliders], or one if no mesh moves
};

} // namespace marram
