// SPDX-License-Identifier: Apache-2.0
// Geometry that the next frame reuses: unchanged meshes, and collider scenes that hold only these. A mesh is
// reused if its digest (MeshGeometry::digest) is the same; it is not copied or checked again, and its BVH
// is not rebuilt. Arrays are moved from one world to the next, never duplicated.
#pragma once

#include "core/geometry/world.h"
#include "core/world/device.h"

#include <optional>

namespace marram {

struct KeptGeometry {
    std::shared_ptr<RTCDeviceTy> device; // collider scenes belong to it
    std::shared_ptr<DeviceState> device_state;
    std::map<uint32_t, MeshGeometry> growth_surfaces, render_meshes; // by geometry ID
    ColliderScenes collider_scenes;

    // Moves out the mesh of that ID and digest (0 never matches). If its digest or roles differ, it is
    // freed, and with a growth surface also the scenes that hold it.
    std::optional<MeshGeometry> take_growth_surface(uint32_t id, uint64_t digest, uint32_t roles);
    std::optional<MeshGeometry> take_render_mesh(uint32_t id, uint64_t digest);
};

// Takes what can be reused out of a world and frees the rest.
KeptGeometry kept_geometry(World world);

} // namespace marram
