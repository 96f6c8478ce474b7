// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/lent_meshes.h"

#include "core/geometry/embree_buffer.h"

#include <cmath>
#include <cstring>

namespace marram {
namespace {

void copy(const std::vector<Vec3f>& from, float* to) {
    std::memcpy(to, from.data(), from.size() * sizeof(Vec3f));
}

} // namespace

LentMeshes::LentMeshes(const World& world, const SceneGeometry& geometry, std::vector<double> times)
    : world_(world), geometry_(geometry), times_(std::move(times)) {
    lists_.resize(world.meshes.size());
    for (size_t i = 0; i < world.meshes.size(); ++i) {
        const MeshGeometry& mesh = world.meshes[i];
        Lists& list = lists_[i];
        const auto pose = [&](std::vector<Vec3f> vectors, std::vector<const float*>& to) {
            to.push_back(components(posed_.emplace_back(std::move(vectors)))); // elements stay where they are
        };
        if (mesh.positions.size() == 1 || mesh.positions.size() == times_.size()) {
            for (const auto& positions : mesh.positions) list.positions.push_back(components(positions));
            for (const auto& normals : mesh.normals) list.normals.push_back(components(normals));
        } else {
            for (const double time : times_) {
                pose(geometry.meshes[i].positions_at(time), list.positions);
                if (!mesh.normals.empty()) pose(geometry.meshes[i].normals_at(time), list.normals);
            }
        }
        meshes_.push_back({mesh.name.c_str(), uint32_t(i), uint32_t(mesh.positions[0].size()),
                           uint32_t(mesh.triangles.size()), uint32_t(list.positions.size()),
                           list.positions.data(), mesh.normals.empty() ? nullptr : list.normals.data(),
                           components(mesh.triangles), components(mesh.uvs)});
    }
}

MarramFrame LentMeshes::frame(const BuildSettings& settings, bool colliders) {
    MarramFrame frame{};
    frame.fps = settings.fps;
    frame.frame = settings.frame;
    frame.bind_frame = settings.bind_frame;
    frame.time_count = uint32_t(times_.size());
    frame.times = times_.data();
    frame.stage = settings.stage;
    frame.tolerance = settings.tolerance;
    for (int axis = 0; axis < 3; ++axis) frame.camera_position[axis] = settings.view.position[axis];
    frame.pixel_angle = settings.view.pixel_angle;
    frame.device = world_.device.get();
    frame.colliders = colliders ? world_.colliders.get() : nullptr;
    frame.mesh_count = uint32_t(meshes_.size());
    frame.meshes = meshes_.data();
    frame.pose = pose;
    frame.pose_user = this;
    return frame;
}

MarramStatus LentMeshes::pose(void* user, uint32_t index, double frame, float* positions, float* normals) {
    const LentMeshes& lent = *static_cast<LentMeshes*>(user);
    if (index >= lent.meshes_.size() || !std::isfinite(frame)) return MARRAM_ERROR;
    const MeshGeometry& placed = lent.world_.meshes[index];
    const bool wants_normals = normals && !placed.normals.empty();
    if (index < lent.geometry_.meshes.size()) {
        const SceneMesh& mesh = lent.geometry_.meshes[index];
        copy(mesh.positions_at(frame), positions);
        if (wants_normals) copy(mesh.normals_at(frame), normals);
    } else { // made by a procedural: it has one pose
        copy(placed.positions[0], positions);
        if (wants_normals) copy(placed.normals[0], normals);
    }
    return MARRAM_OK;
}

} // namespace marram
