// SPDX-License-Identifier: Apache-2.0
// Copies the valid triangles of a mesh into an Embree scene in the wind frame, and traces rays through it.
#include "procedural/terrain/ruin/ruin_mesh.h"

#include "core/math/digest.h"

#include <algorithm>
#include <cmath>
#include <new>

namespace marram {
namespace {

struct RuinTriangles {
    std::vector<float> positions;
    std::vector<uint32_t> triangles;
};

bool ruin_valid_position(const float* p) {
    return std::abs(p[0]) <= ruin_farthest && std::abs(p[1]) <= ruin_farthest &&
           std::abs(p[2]) <= ruin_farthest;
}

// The triangles with three valid vertices: indices in range, positions finite and within ruin_farthest.
std::vector<uint32_t> ruin_valid_triangles(const MarramMesh& mesh) {
    std::vector<uint32_t> good;
    const float* positions = mesh.positions ? mesh.positions[0] : nullptr;
    if (!positions || !mesh.triangles) return good;
    for (size_t f = 0; f < mesh.triangle_count; ++f) {
        const uint32_t* v = mesh.triangles + 3 * f;
        bool in = true;
        for (int k = 0; k < 3; ++k)
            in = in && v[k] < mesh.vertex_count && ruin_valid_position(positions + 3 * size_t(v[k]));
        if (in) good.insert(good.end(), v, v + 3);
    }
    return good;
}

Vec2d ruin_centre(const MarramMesh& mesh, const std::vector<uint32_t>& triangles) {
    Vec2d low = Vec2d::Constant(infinity), high = -low;
    for (const uint32_t v : triangles) {
        const float* p = mesh.positions[0] + 3 * size_t(v);
        const Vec2d at(p[0], p[2]);
        low = low.cwiseMin(at), high = high.cwiseMax(at);
    }
    return 0.5 * (low + high);
}

// The device is released after its last scene: Embree 4.4.1 frees a device that its last scene releases while
// that scene still uses it.
void ruin_release(RTCScene scene, RTCDevice device) {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}

std::shared_ptr<RTCSceneTy> ruin_scene_of(const RuinTriangles& mesh, RTCScene beside) {
    const RTCDevice device =
        beside ? rtcGetSceneDevice(beside) : rtcNewDevice("set_affinity=0,start_threads=0");
    if (!device) throw std::bad_alloc();
    const std::shared_ptr<RTCSceneTy> owner(rtcNewScene(device),
                                            [device](RTCScene scene) { ruin_release(scene, device); });
    const RTCScene scene = owner.get();
    // Robust: a ray that hits a shared edge does not miss both triangles.
    rtcSetSceneFlags(scene, RTCSceneFlags(RTC_SCENE_FLAG_ROBUST | MARRAM_SCENE_FILTER));
    const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                              3 * sizeof(float), mesh.positions.size() / 3);
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(uint32_t), mesh.triangles.size() / 3);
    if (positions && triangles) {
        std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<float*>(positions));
        std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<uint32_t*>(triangles));
        rtcSetGeometryMask(geometry, MARRAM_NAMED);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcCommitScene(scene);
    }
    rtcReleaseGeometry(geometry);
    if (!positions || !triangles) throw std::bad_alloc();
    return owner;
}

RTCRay ruin_ray(const Vec3d& from, const Vec3d& direction, double length) {
    const Vec3f p = from.cast<float>(), d = direction.cast<float>();
    RTCRay ray{};
    ray.org_x = p.x(), ray.org_y = p.y(), ray.org_z = p.z();
    ray.dir_x = d.x(), ray.dir_y = d.y(), ray.dir_z = d.z();
    ray.tnear = 0.0F, ray.tfar = float(length);
    ray.mask = MARRAM_NAMED;
    return ray;
}

} // namespace

RuinMesh::RuinMesh(const MarramMesh& mesh, const Vec2d& wind, RTCScene scene) {
    const double speed = wind.stableNorm();
    if (speed > 0.0 && std::isfinite(speed)) frame_.along = wind / speed;
    frame_.across = Vec2d(-frame_.along.y(), frame_.along.x());
    const std::vector<uint32_t> good = ruin_valid_triangles(mesh);
    if (good.empty()) return;
    frame_.origin = ruin_centre(mesh, good);
    RuinTriangles own;
    std::vector<uint32_t> renumbered(mesh.vertex_count, UINT32_MAX);
    lower_ = Vec3d::Constant(infinity), upper_ = -lower_;
    for (const uint32_t v : good) {
        if (renumbered[v] == UINT32_MAX) {
            renumbered[v] = uint32_t(own.positions.size() / 3);
            const float* p = mesh.positions[0] + 3 * size_t(v);
            const Vec2d flat = frame_.frame(Vec2d(p[0], p[2]));
            for (const double c : {flat.x(), double(p[1]), flat.y()}) own.positions.push_back(float(c));
            const Vec3d at(own.positions.end()[-3], own.positions.end()[-2], own.positions.end()[-1]);
            lower_ = lower_.cwiseMin(at), upper_ = upper_.cwiseMax(at);
        }
        own.triangles.push_back(renumbered[v]);
    }
    digest_ = Digest()
                  .add(own.positions)
                  .add(own.triangles)
                  .add(&frame_.origin, sizeof(Vec2d))
                  .add(&frame_.along, sizeof(Vec2d))
                  .value();
    scene_ = ruin_scene_of(own, scene);
}

namespace {

// Filter function: records a hit and rejects it, so that the ray continues.
void ruin_record_hit(const RTCFilterFunctionNArguments* args) {
    if (args->valid[0] == 0) return;
    constexpr size_t most = 4096; // hits that are kept; a scene where one ray has more is not a building
    auto& found = *static_cast<std::vector<RuinMesh::Hit>*>(marram_query_of(args));
    const Vec3d n(RTCHitN_Ng_x(args->hit, args->N, 0), RTCHitN_Ng_y(args->hit, args->N, 0),
                  RTCHitN_Ng_z(args->hit, args->N, 0));
    const double length = n.stableNorm();
    if (length > 0.0 && found.size() < most)
        found.push_back({double(RTCRayN_tfar(args->ray, args->N, 0)), n / length});
    args->valid[0] = 0;
}

} // namespace

void RuinMesh::hits(const Vec3d& from, const Vec3d& direction, double length, std::vector<Hit>& found) const {
    found.clear();
    RTCRayHit query{};
    query.ray = ruin_ray(from, direction, length);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1_filtered(scene_.get(), &query, 0, ruin_record_hit, &found);
    // At equal distance the entering hit comes first, so that touching solids count as one.
    std::sort(found.begin(), found.end(), [&](const Hit& a, const Hit& b) {
        return a.at != b.at ? a.at < b.at : a.normal.dot(direction) < b.normal.dot(direction);
    });
}

Vec3d RuinMesh::first(const Vec3d& from, const Vec3d& direction, double length) const {
    RTCRayHit query{};
    query.ray = ruin_ray(from, direction, length);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(scene_.get(), &query, 0);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return Vec3d::Zero();
    return Vec3d(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z).stableNormalized();
}

bool RuinMesh::occluded(const Vec3d& from, const Vec3d& direction, double length) const {
    RTCRay ray = ruin_ray(from, direction, length);
    marram_occluded1(scene_.get(), &ray);
    return ray.tfar < 0.0F;
}

} // namespace marram
