// SPDX-License-Identifier: Apache-2.0
#include "core/world/kept_geometry.h"

#include <algorithm>
#include <utility>

namespace marram {
namespace {

std::optional<MeshGeometry> take(std::map<uint32_t, MeshGeometry>& meshes, uint32_t id, uint64_t digest) {
    auto node = meshes.extract(id);
    if (!node || digest == 0 || node.mapped().digest != digest) return std::nullopt;
    return std::move(node.mapped());
}

} // namespace

std::optional<MeshGeometry> KeptGeometry::take_growth_surface(uint32_t id, uint64_t digest, uint32_t roles) {
    std::optional<MeshGeometry> mesh = take(growth_surfaces, id, digest);
    if (mesh && mesh->roles == roles) return mesh; // Embree's mask is made of the roles
    std::erase_if(collider_scenes,
                  [&](const auto& scene) { return std::ranges::find(scene.first, id) != scene.first.end(); });
    return std::nullopt;
}

std::optional<MeshGeometry> KeptGeometry::take_render_mesh(uint32_t id, uint64_t digest) {
    return take(render_meshes, id, digest);
}

KeptGeometry kept_geometry(World world) {
    KeptGeometry kept;
    for (uint32_t id = 0; id < world.meshes.size(); ++id) {
        const auto growth = world.growth_surfaces.find(id);
        const bool has_render_mesh = growth != world.growth_surfaces.end();
        MeshGeometry& surface = has_render_mesh ? growth->second : world.meshes[id];
        if (surface.digest != 0) kept.growth_surfaces.emplace(id, std::move(surface));
        if (has_render_mesh && world.meshes[id].digest != 0)
            kept.render_meshes.emplace(id, std::move(world.meshes[id]));
    }
    for (auto& [ids, scene] : world.collider_scenes)
        if (std::ranges::all_of(ids, [&](uint32_t id) { return kept.growth_surfaces.contains(id); }))
            kept.collider_scenes.emplace(ids, std::move(scene));
    kept.device = std::move(world.device);
    kept.device_state = std::move(world.device_state);
    return kept;
}

} // namespace marram
