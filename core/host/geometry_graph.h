// SPDX-License-Identifier: Apache-2.0
// The order in which procedurals are made: each after the geometry that it depends on.
#pragma once

#include "core/host/plugin_host.h"

#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace marram {

// True if the procedural must be made after the mesh: its parameters name the mesh, or it makes curves and
// `roles` (MarramRole bits of the mesh) says that the mesh collides with strands or shelters them.
bool depends_on_mesh(const Procedural& procedural, const std::string& mesh, uint32_t roles);

// True if `procedural` reads geometry that `other` makes, directly.
bool depends_on(const Procedural& procedural, const Procedural& other);

// Topological order, as indices into `procedurals`: each comes after all that it depends on. Throws
// InputError if the dependencies form a cycle; the message lists it.
std::vector<size_t> order_of(std::span<const std::unique_ptr<Procedural>> procedurals);

// Name of a mesh, curves or procedural -> MarramChange bits of what has changed. Not listed: unchanged.
using GeometryChanges = std::map<std::string, uint32_t>;

// Updates procedurals in place: procedurals[i] takes the new values of items[i] and the scene's wind. In
// dependency order, each is told which of its inputs have changed; one without a changed value or input is
// not called. `changes`: in, those of the scene's own meshes and curves (the caller compares digests); out,
// those of procedurals, including their roles, are added. Throws InputError if a procedural rejects its
// values. It then keeps its previous values, those earlier in the order stay updated, and dependents of what
// has changed are told by the next update.
void update_procedurals(std::span<const std::unique_ptr<Procedural>> procedurals, std::span<const Item> items,
                        const ParamSet& wind, GeometryChanges& changes);

} // namespace marram
