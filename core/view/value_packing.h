// SPDX-License-Identifier: Apache-2.0
// Attributes of strands and meshes, which a page shows as colours: the share of the wind, contacts, sand.
#pragma once

#include "core/shot/shot.h"
#include "core/view/mesh_packing.h"
#include "core/view/strand_packing.h"

#include <string>
#include <vector>

namespace marram {

// The attributes of one number that a shot's procedurals give their strands and meshes: { name, help,
// discrete }.
nlohmann::json drawable_values(const Shot& shot);

// Appends an attribute of the chosen strands and of drawn meshes to a frame's message. The message must have
// the strands' positions already (add_strand_positions). header["values"] = { name, lower, upper }: the range
// over all. A value is 16 bits a vertex, 0 for lower and 65535 for upper; not a number is lower. A chunk's
// offset is its "values", a mesh's is in header["mesh_values"] = [{ index, offset }]. Strands and meshes that
// do not have the attribute are left out; if none has it, lower and upper are 0.
void add_values(const World& world, const StrandSelection& selection, const std::vector<DrawnMesh>& drawn,
                const std::string& name, WireMessage& message);

} // namespace marram
