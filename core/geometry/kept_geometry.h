// SPDX-License-Identifier: Apache-2.0
// What one frame leaves to the next: meshes that rest, and collider scenes of nothing but these. A mesh is taken over where its version is
// the same (MeshGeometry::version); then it is not copied, checked or traced anew. Costs no memory while frames are traced: a world holds
// the same arrays.
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

    // The mesh of that version, which is then no longer here. Any other mesh of that ID is freed, and with a growth surface the
    // scenes that hold it.
    std::optional<MeshGeometry> take_growth_surface(uint32_t id, uint64_t version, uint32_t roles);
    std::optional<MeshGeometry> take_render_mesh(uint32_t id, uint64_t version);
};

// Frees all else that the world holds.
KeptGeometry kept_geometry(World world);

} // namespace marram
