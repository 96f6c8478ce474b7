// SPDX-License-Identifier: Apache-2.0
// Attributes of strands and meshes as colours: the share of the wind, contacts, sand.
#pragma once

#include "core/shot/shot.h"
#include "core/view/mesh_packing.h"
#include "core/view/strand_packing.h"

#include <string>
#include <vector>

namespace marram {

// The attributes of one number that a shot's procedurals give their strands and meshes: { name, help, discrete }.
nlohmann::json drawable_values(const Shot& shot);

// Appends the attribute of the chosen strands, and of drawn meshes, to a frame's message, after
// add_strand_positions(): header["values"] = { name, lower, upper }, the range over all; then 16 bits a
// vertex, 0 lower and 65535 upper: each chunk's offset is its "values", and a mesh's is in
// header["mesh_values"] = [{ index, offset }]. What does not have the attribute is left out. Without any
// value lower and upper are 0.
void add_values(const World& world, const StrandSelection& selection, const std::vector<DrawnMesh>& drawn,
                const std::string& name, WireMessage& message);

} // namespace marram
