// SPDX-License-Identifier: Apache-2.0
// guides.wind = "guides": the wind blows the guides, and their children blend its motion.
//
// Guides run through the chain like strands, but for collision: gusts, shielding, bend and jiggle at the places of their own roots. A
// child's target is then the blend of its guides as they are blown, in the way that its rest shape is the blend of them at rest
// (guides.h), with its own clump, curl, frizz and length; and it collides for itself. Off by what wind differs from a guide's root to a
// child's: noise, gusts and shelters smaller than the guides' distances are lost. Cost of the wind: that of the guides.
#pragma once

#include "procedural/groom/groom_instance.h"

namespace marram {

// Blows the guides of the frame that has begun: fills instance.guide_motion. Nothing where the scene does not ask for it, or where no
// wind blows.
void blow_guides(GroomInstance& instance);

// strands.rest as expanded at motion sample `time` -> pose, pose_normal, envelope, gust, shield.
void follow_guides(const GroomInstance& instance, const GroomPatch& patch, uint32_t time, Strands& strands);

} // namespace marram
