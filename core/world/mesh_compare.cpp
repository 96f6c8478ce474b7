// SPDX-License-Identifier: Apache-2.0
#include "core/world/mesh_compare.h"

#include "core/plugin/embree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace marram {
namespace {

// A scene of one mesh of a world, which need not be committed.
class MeshScene {
  public:
    MeshScene(const World& world, uint32_t mesh) : scene_(rtcNewScene(world.device.get())) {
        rtcAttachGeometryByID(scene_, rtcGetGeometry(world.scene.get(), mesh), 0);
        rtcCommitScene(scene_);
    }
    ~MeshScene() { rtcReleaseScene(scene_); }
    MeshScene(const MeshScene&) = delete;
    MeshScene& operator=(const MeshScene&) = delete;

    // The distance of the mesh from a point along a normal, at most `reach`.
    double distance_along(const Vec3f& point, const Vec3f& normal, float reach) const {
        double nearest = double(reach);
        for (const float side : {1.0F, -1.0F}) {
            // From a little behind the point, which may be on the mesh.
            const float behind = 1e-3F * reach;
            const Vec3f from = point - side * behind * normal, way = side * normal;
            RTCRayHit ray{};
            ray.ray.org_x = from.x(), ray.ray.org_y = from.y(), ray.ray.org_z = from.z();
            ray.ray.dir_x = way.x(), ray.ray.dir_y = way.y(), ray.ray.dir_z = way.z();
            ray.ray.tfar = reach + behind;
            ray.ray.mask = ~0U;
            ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
            marram_intersect1(scene_, &ray, 0);
            if (ray.hit.geomID == 0) nearest = std::min(nearest, std::abs(double(ray.ray.tfar - behind)));
        }
        return nearest;
    }

  private:
    RTCScene scene_;
};

} // namespace

void MeshDistance::add(double distance) {
    squares += distance * distance, count += 1.0;
    worst = std::max(worst, distance);
}

void MeshDistance::add(const MeshDistance& other) {
    squares += other.squares, count += other.count;
    worst = std::max(worst, other.worst);
}

double MeshDistance::rms() const { return count > 0.0 ? std::sqrt(squares / count) : 0.0; }

MeshDistance mesh_distance(const World& world, uint32_t mesh, const MeshGeometry& from) {
    MeshDistance sum;
    constexpr size_t enough = 100000; // vertices, at regular intervals
    const MeshScene scene(world, mesh);
    const std::vector<Vec3f>& points = from.positions[0];
    std::vector<Vec3f> normals(points.size(), Vec3f::Zero());
    Box3f box;
    for (const std::array<uint32_t, 3>& t : from.triangles) {
        const Vec3f n = (points[t[1]] - points[t[0]]).cross(points[t[2]] - points[t[0]]);
        for (const uint32_t v : t) normals[v] += n, box.extend(points[v]);
    }
    const size_t step = std::max((points.size() + enough - 1) / enough, size_t(1));
    const float reach = 0.05F * box.sizes().maxCoeff();
    for (size_t v = 0; v < points.size(); v += step)
        if (const float size = normals[v].norm(); size > 0.0F)
            sum.add(scene.distance_along(points[v], normals[v] / size, reach));
    return sum;
}

} // namespace marram
