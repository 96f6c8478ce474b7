// SPDX-License-Identifier: Apache-2.0
// A copy of the ruin's mesh in the wind frame, and the rays that are traced through it.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/embree.h"
#include "core/plugin/marram_plugin.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace marram {

inline constexpr double ruin_farthest = 0x1p20; // m: float resolution below this is 6 cm or better
// Ray position in its interval: avoids hits on symmetric geometry.
inline constexpr double ruin_ray_offset = 0.487;

// The wind frame: s along the wind, t across it, origin at the centre of the mesh.
struct RuinFrame {
    Vec2d origin = Vec2d::Zero(), along = Vec2d(1.0, 0.0), across = Vec2d(0.0, 1.0);
    Vec2d world(double s, double t) const { return origin + s * along + t * across; }
    Vec2d frame(const Vec2d& p) const { return {(p - origin).dot(along), (p - origin).dot(across)}; }
};

// A copy of the mesh in its own Embree scene, in the wind frame (x = s, y = height, z = t). It may outlive
// the scene of the mesh. Triangles with a vertex beyond ruin_farthest or with an invalid index are left out.
class RuinMesh {
  public:
    RuinMesh(const MarramMesh& mesh, const Vec2d& wind, RTCScene scene);

    bool empty() const { return !scene_; }
    const RuinFrame& frame() const { return frame_; }
    const Vec3d& lower() const { return lower_; }
    const Vec3d& upper() const { return upper_; }
    uint64_t digest() const { return digest_; }
    struct Hit {
        double at;    // m along the ray
        Vec3d normal; // unit, outward
    };
    // All hits of a ray of `length` (m) from `from` along the unit vector `direction`, sorted by distance.
    void hits(const Vec3d& from, const Vec3d& direction, double length, std::vector<Hit>& found) const;
    // The normal at the nearest hit; zero if there is none.
    Vec3d first(const Vec3d& from, const Vec3d& direction, double length) const;
    // True if there is a hit.
    bool occluded(const Vec3d& from, const Vec3d& direction, double length) const;

  private:
    RuinFrame frame_;
    Vec3d lower_ = Vec3d::Zero(), upper_ = Vec3d::Zero();
    uint64_t digest_ = 0;
    std::shared_ptr<RTCSceneTy> scene_;
};

} // namespace marram
