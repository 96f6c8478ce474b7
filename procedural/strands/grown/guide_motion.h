// SPDX-License-Identifier: Apache-2.0
// guides.wind = "guides": the wind blows the guides, and their children blend the guides' motion.
//
// Guides go through the chain like strands, without collision: gusts, shielding, bend and jiggle at their own
// roots. The target of a child is the blend of its blown guides, computed like its rest shape from the guides
// at rest (guides.h), with its own clump, curl, frizz and length. Each child collides individually. The error
// is the difference of the wind between a guide's root and a child's: noise, gusts and shelters smaller than
// the distance between guides are lost. Cost of the wind: that of the guides.
#pragma once

#include "procedural/strands/grown/groom_instance.h"

namespace marram {

// Blows the guides at the current frame and fills instance.guide_motion. Leaves it empty if the scene does
// not ask for it or no wind blows.
void blow_guides(GroomInstance& instance);

// Fills pose, pose_normal, envelope, gust and shield at motion sample `time`. strands.rest, expanded at the
// same time, is kept.
void follow_guides(const GroomInstance& instance, const GroomPatch& patch, uint32_t time, Strands& strands);

} // namespace marram
