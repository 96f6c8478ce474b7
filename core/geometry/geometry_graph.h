// SPDX-License-Identifier: Apache-2.0
// The order in which procedurals are made: each after the geometry that it depends on.
#pragma once

#include "core/geometry/plugin_host.h"

#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Whether a procedural sees a mesh: it names it; or it makes curves, and the mesh collides or shelters.
bool depends_on_mesh(const Procedural& procedural, const std::string& mesh, uint32_t roles);

bool depends_on(const Procedural& procedural, const Procedural& other);

// Indices of the procedurals in an order that puts each behind all that it depends on; otherwise as they stand. Throws InputError where
// there is a ring, which names it.
std::vector<size_t> order_of(std::span<const std::unique_ptr<Procedural>> procedurals);

// What has changed of geometry, MarramChange bits by name.
using GeometryChanges = std::map<std::string, uint32_t>;

// Takes over other values of the same procedurals, item for item, in the order of the graph; each is told what has changed of what it
// depends on. `changes` says what has changed of the scene's own meshes and curves, found out by their digests; that of procedurals is
// added to it, a change of roles included. What nothing touches is not called. Throws InputError for what a procedural objects to: it is as it
// was then, and those that depend on what has changed are told by the next update.
void update_procedurals(std::span<const std::unique_ptr<Procedural>> procedurals, std::span<const Item> items,
                        const ParamSet& wind, GeometryChanges& changes);

} // namespace marram
