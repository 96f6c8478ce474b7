// SPDX-License-Identifier: Apache-2.0
// The rest strands of a groom on one of its mesh instances, as the chain asks for them: at motion samples and at
// knots of jiggle's window. Strands are laid out on the groom's own mesh and then transformed to the instance.
#pragma once

#include "procedural/groom/groom_instance.h"

#include <functional>

namespace marram {

// Lays out strands on the groom's own mesh, whose skin is `now`.
using LayOutStrands = std::function<void(const Surface& now, Strands& strands)>;

// `clock`: gets the time of motion samples as `expand`; nullptr: it is not measured. That of knots is part of
// jiggle's. All references must outlive the result.
RestStrandSource rest_strands_on(const GroomInstance& instance, const MeshInstance& mesh_instance,
                                 LayOutStrands lay_out, StageClock* clock);

// Transforms strands laid out on the groom's own mesh to where the mesh instance is, at a motion sample.
void transform_to_instance(const GroomInstance& instance, const MeshInstance& mesh_instance, uint32_t time,
                           Strands& strands);

} // namespace marram
