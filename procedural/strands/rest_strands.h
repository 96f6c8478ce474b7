// SPDX-License-Identifier: Apache-2.0
// The rest strands of a groom on one of its mesh instances, as the chain asks for them: at motion samples and
// at the past samples of jiggle's window. Strands are laid out on the groom's own mesh and then transformed
// to the instance.
#pragma once

#include "procedural/strands/grown/groom_instance.h"

#include <functional>

namespace marram {

// Lays out strands on a pose of the groom's own mesh.
using LayOutStrands = std::function<void(const Surface& surface, Strands& strands)>;

// `clock`: its `expand` gets the time taken at motion samples; nullptr: not measured. The time at past
// samples counts as jiggle. All references must outlive the result.
RestStrandSource rest_strand_source(const GroomInstance& instance, const MeshInstance& mesh_instance,
                                    LayOutStrands lay_out, StageClock* clock);

// Transforms strands laid out on the groom's own mesh to where the mesh instance is at motion sample `time`.
// Leaves them as they are if it is that mesh itself.
void transform_to_instance(const GroomInstance& instance, const MeshInstance& mesh_instance, uint32_t time,
                           Strands& strands);

} // namespace marram
