// SPDX-License-Identifier: Apache-2.0
// Writes strands from their SIMD layout to the host's buffers.
#pragma once

#include "procedural/strands/grown/groom_instance.h"

#include <span>

namespace marram {

// Attributes of a groom's curves, in the order of their indices in the contract.
std::span<const MarramAttribute> groom_attributes();
bool asks_for_contact(const MarramPatchBuffers& buffers);

// One motion sample of a patch: count * (CVs + 2) vertices of four floats, including the phantom CVs at both
// ends.
void write_vertices(const GroomInstance& instance, const GroomPatch& patch, const Strands& strands,
                    float* out);

// count * (CVs + 2) normals of three floats.
void write_normals(const Strands& strands, size_t count, float* out);

// One value per strand or per CV, depending on the attribute's rate.
void write_attribute(const GroomInstance& instance, const GroomPatch& patch, const Strands& strands,
                     uint32_t which, float* out);

} // namespace marram
