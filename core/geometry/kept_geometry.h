// SPDX-License-Identifier: Apache-2.0
// What one frame leaves to the next: unchanged meshes, and the collider scenes of nothing but these. A mesh is reused where its version is
// the same (MeshGeometry::version); it is then neither copied nor checked again, nor is its BVH rebuilt. Arrays are moved out of the world
// and into the next one: they are never there twice.
#pragma once

#include "core/geometry/device.h"
#include "core/geometry/world.h"

#include <optional>

namespace marram {

struct KeptGeometry {
    std::shared_ptr<RTCDeviceTy> device; // collider scenes belong to it
    std::shared_ptr<DeviceErrors> errors;
    std::map<uint32_t, MeshGeometry> growth_surfaces, render_meshes; // by geometry ID
    ColliderScenes collider_scenes;

    // Moves out the mesh of that ID and version (0: none is). Of another version, or for other roles, it is freed, and with a growth surface
    // the scenes that hold it.
    std::optional<MeshGeometry> take_growth_surface(uint32_t id, uint64_t version, uint32_t roles);
    std::optional<MeshGeometry> take_render_mesh(uint32_t id, uint64_t version);
};

// Frees all else that the world holds.
KeptGeometry kept_geometry(World world);

} // namespace marram
