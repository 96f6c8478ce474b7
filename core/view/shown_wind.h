// SPDX-License-Identifier: Apache-2.0
// What pages show of the wind besides the strands: arrows on a plane, and the rays by which a strand finds
// shelter.
#pragma once

#include "core/geometry/world.h"
#include "core/shot/shot.h"
#include "core/view/inbox.h"
#include "core/view/wire.h"

namespace marram {

// Appends the wind at the plane's points, at the frame that the shot's procedurals have begun: header["air"]
// = { counts: [columns, rows], offset: bytes }, and at offset seven floats a point, columns fastest: x, y, z
// of the velocity, m/s, and of the noise, and the share, as of MarramProcedural.air. Points are the centres
// of cells. The wind is that of the first procedural that tells it; if none does, nothing is added.
void add_air(const Shot& shot, const AirPlane& plane, WireMessage& message);

// "rays": of a strand (its index) of world.curves[part], which is at rest and has root_normal. Each ray is
// [from, to, shelter]: m, world space, and 0 ... 1, as of MarramProcedural.shelter_rays; of more than 4000
// each so many-th is given. "shelter": the mean of all. Without wind.shielding there are no rays.
nlohmann::json rays_message(const Shot& shot, const World& world, size_t part, uint64_t strand);

} // namespace marram
