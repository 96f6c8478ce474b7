// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/covered_roots.h"

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
// Heights of faces above the skin, relative to the root offset: in its plane; the most that ground has.
constexpr double on_skin = 0.01, max_ground = 0.5;

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

// Whether the ray leaves the mesh where it hits it: it meets the back of a face.
bool leaves(const RTCRayHit& ray) {
    return double(ray.hit.Ng_x) * double(ray.ray.dir_x) + double(ray.hit.Ng_y) * double(ray.ray.dir_y) +
               double(ray.hit.Ng_z) * double(ray.ray.dir_z) >
           0.0;
}

// All hits along a ray, in order, until see(ray) returns true.
void each_hit(RTCScene scene, RTCRayHit ray, const auto& see) {
    const RTCRayHit first = ray;
    for (;;) {
        marram_intersect1(scene, &ray, 0);
        if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID || see(ray)) return;
        const float at = ray.ray.tfar;
        ray = first;
        ray.ray.tnear = std::nextafter(at * (1.0F + 0x1p-22F), std::numeric_limits<float>::infinity());
        if (ray.ray.tnear >= ray.ray.tfar) return;
    }
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

bool has_instances(const MarramFrame& frame, std::span<const MarramMesh> meshes, const MarramMesh& skin) {
    const auto skin_index = uint32_t(&skin - meshes.data());
    return std::ranges::any_of(meshes.first(frame.mesh_count),
                               [&](const MarramMesh& mesh) { return mesh.instance_of == skin_index + 1; });
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

int RootCover::enclosing(const Vec3d& point) const {
    if (std::ranges::none_of(bounds_, [&](const auto& box) { return box.contains(point); })) return -1;
    struct Rays {
        int odd = 0, from_inside = 0; // of cover_ray_count
    };
    std::vector<Rays> rays(meshes_.size());
    std::vector<int> crossings(meshes_.size());
    static const std::array<Vec3d, cover_ray_count> directions = cover_directions();
    for (const Vec3d& direction : directions) {
        std::ranges::fill(crossings, 0);
        each_hit(scene_, cover_ray(point, direction, std::numeric_limits<double>::infinity()),
                 [&](const RTCRayHit& ray) {
                     const size_t mesh = ray.hit.geomID;
                     if (crossings[mesh]++ == 0) rays[mesh].from_inside += leaves(ray);
                     return false;
                 });
        for (size_t i = 0; i < meshes_.size(); ++i) rays[i].odd += crossings[i] % 2;
    }
    const auto found = std::ranges::find_if(rays, [](const Rays& mesh) {
        return mesh.odd >= enclosing_rays && 2 * mesh.from_inside > cover_ray_count;
    });
    return found == rays.end() ? -1 : int(found - rays.begin());
}

int RootCover::covered_by(const Vec3d& root, const Vec3d& start) const {
    if (!root.allFinite() || !start.allFinite()) return -1;
    const Vec3d rise = start - root;
    const double offset = rise.norm();
    bool pierces = false; // a face that is not in the plane of the skin
    int found = -1;
    if (offset > 0.0)
        each_hit(scene_, cover_ray(root - on_skin * rise, rise / offset, (1.0 + on_skin) * offset),
                 [&](const RTCRayHit& ray) {
                     const double height = double(ray.ray.tfar) - on_skin * offset;
                     if (!leaves(ray) || height > max_ground * offset) found = int(ray.hit.geomID);
                     pierces = pierces || height > on_skin * offset;
                     return found >= 0;
                 });
    if (found < 0 && pierces) found = enclosing(root);
    return found >= 0 ? found : enclosing(start);
}

} // namespace marram
