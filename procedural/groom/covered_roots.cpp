// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/covered_roots.h"

#include "core/math/digest.h"
#include "core/plugin/embree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <new>

namespace marram {
namespace {

constexpr int cover_ray_count = 6, enclosing_rays = 5;

// Three directions that no edge of a modelled mesh is likely to have, and their opposites.
std::array<Vec3d, cover_ray_count> cover_directions() {
    const Eigen::Quaterniond turn = Eigen::Quaterniond(0.8119, 0.3417, -0.4231, 0.2153).normalized();
    std::array<Vec3d, cover_ray_count> directions;
    for (int axis = 0; axis < 3; ++axis) {
        directions[size_t(2 * axis)] = turn * Vec3d::Unit(axis);
        directions[size_t(2 * axis + 1)] = -directions[size_t(2 * axis)];
    }
    return directions;
}

RTCRayHit cover_ray(const Vec3d& from, const Vec3d& direction, double length) {
    const Vec3f p = from.cast<float>(), d = direction.cast<float>();
    RTCRayHit ray{};
    ray.ray.org_x = p.x(), ray.ray.org_y = p.y(), ray.ray.org_z = p.z();
    ray.ray.dir_x = d.x(), ray.ray.dir_y = d.y(), ray.ray.dir_z = d.z();
    ray.ray.tfar = float(length);
    ray.ray.mask = ~0U;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    return ray;
}

void attach_covering_mesh(RTCDevice device, RTCScene scene, const MarramMesh& mesh, unsigned id) {
    const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                              3 * sizeof(float), mesh.vertex_count);
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(uint32_t), mesh.triangle_count);
    if (positions && triangles) {
        std::copy_n(mesh.positions[0], 3 * size_t(mesh.vertex_count), static_cast<float*>(positions));
        std::copy_n(mesh.triangles, 3 * size_t(mesh.triangle_count), static_cast<uint32_t*>(triangles));
        rtcSetGeometryMask(geometry, ~0U);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(scene, geometry, id);
    }
    rtcReleaseGeometry(geometry);
    if (!positions || !triangles) throw std::bad_alloc();
}

} // namespace

std::vector<const MarramMesh*> covering_meshes(const MarramFrame& frame, std::span<const MarramMesh> meshes,
                                               const MarramMesh& skin) {
    std::vector<const MarramMesh*> covering;
    const auto is_still = [](const MarramMesh& mesh) { return mesh.time_count <= 1 && mesh.moves == 0; };
    if (!is_still(skin)) return covering;
    const auto skin_index = uint32_t(&skin - meshes.data());
    for (uint32_t i = 0; i < frame.mesh_count; ++i) {
        const MarramMesh& mesh = meshes[i];
        const bool grows = i == skin_index || mesh.instance_of == skin_index + 1;
        if (!grows && (mesh.roles & MARRAM_COLLIDES) != 0 && is_still(mesh) && mesh.triangle_count > 0)
            covering.push_back(&mesh);
    }
    return covering;
}

uint64_t digest_of_meshes(std::span<const MarramMesh* const> meshes) {
    if (meshes.empty()) return 0;
    Digest digest;
    for (const MarramMesh* mesh : meshes)
        digest.add(mesh->positions[0], 12 * size_t(mesh->vertex_count))
            .add(mesh->triangles, 12 * size_t(mesh->triangle_count));
    return digest.value();
}

RootCover::RootCover(RTCDevice device, std::vector<const MarramMesh*> meshes)
    : meshes_(std::move(meshes)), device_(device), scene_(rtcNewScene(device)) {
    rtcRetainDevice(device_); // released after its scene, see ruin_release()
    // Robust: a ray through a shared edge does not miss both triangles.
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (size_t i = 0; i < meshes_.size(); ++i) {
        attach_covering_mesh(device_, scene_, *meshes_[i], unsigned(i));
        Eigen::AlignedBox3d& box = bounds_.emplace_back();
        for (size_t v = 0; v < meshes_[i]->vertex_count; ++v)
            box.extend(Eigen::Map<const Vec3f>(meshes_[i]->positions[0] + 3 * v).cast<double>());
    }
    rtcCommitScene(scene_);
}

RootCover::~RootCover() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
}

int RootCover::covered_by(const Vec3d& root, const Vec3d& start) const {
    if (!root.allFinite() || !start.allFinite()) return -1;
    const Vec3d rise = start - root;
    const double offset = rise.norm();
    if (offset > 0.0) {
        constexpr double below = 0.01; // of the root offset: finds faces that lie on the skin
        RTCRayHit ray = cover_ray(root - below * rise, rise / offset, (1.0 + below) * offset);
        marram_intersect1(scene_, &ray, 0);
        if (ray.hit.geomID != RTC_INVALID_GEOMETRY_ID) return int(ray.hit.geomID);
    }
    if (std::ranges::none_of(bounds_, [&](const auto& box) { return box.contains(start); })) return -1;
    std::vector<int> odd_rays(meshes_.size(), 0), crossings(meshes_.size());
    static const std::array<Vec3d, cover_ray_count> directions = cover_directions();
    for (const Vec3d& direction : directions) {
        std::ranges::fill(crossings, 0);
        RTCRayHit ray = cover_ray(start, direction, std::numeric_limits<double>::infinity());
        for (;;) {
            marram_intersect1(scene_, &ray, 0);
            if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) break;
            ++crossings[ray.hit.geomID];
            const float at = ray.ray.tfar;
            ray = cover_ray(start, direction, std::numeric_limits<double>::infinity());
            ray.ray.tnear = std::nextafter(at * (1.0F + 0x1p-22F), std::numeric_limits<float>::infinity());
        }
        for (size_t i = 0; i < meshes_.size(); ++i) odd_rays[i] += crossings[i] % 2;
    }
    const auto enclosing = std::ranges::find_if(odd_rays, [](int odd) { return odd >= enclosing_rays; });
    return enclosing == odd_rays.end() ? -1 : int(enclosing - odd_rays.begin());
}

} // namespace marram
