// SPDX-License-Identifier: Apache-2.0
// Wind shielding: strands behind a collider get less wind. See shield.cpp for what exactly is counted.
#pragma once

#include "procedural/values.h"
#include "procedural/wind/colliders.h"
#include "procedural/wind/strands.h"

#include <optional>
#include <span>

namespace marram {

struct Shielding {
    double shield = 1.0;                // how much of the wind a wholly sheltered strand loses
    double offset = 0.0;                // m: how far upwind obstacles count
    bool per_cv = false;                // else one share for a strand
    std::optional<double> wake;         // m behind the obstacle at which shelter has faded out
    std::optional<double> wake_heights; // the same in heights of the obstacle
    double spread = 0.0;                // radians: half angle of the cone of rays; 0: one ray
    int rays = 8;                       // of the cone
};

std::span<const MarramParam> shielding_params();
std::optional<Shielding> read_shielding(const Values& values); // nothing where the scene asks for none

// Vertical extent of each mesh at the colliders' instant, [geometry ID]; what wake_heights counts in.
std::vector<double> obstacle_heights(const Colliders& colliders);

// strands.rest -> strands.shield: the sheltered share of each CV, the same for all CVs of a strand unless per_cv.
// `heights` is read only where wake_heights is given. Cost: one ray a CV (times `rays` with spread), traced 256 at a time.
void shield(const Shielding& shielding, const Vec3d& wind, const Colliders& colliders,
            std::span<const double> heights, Strands& strands);

} // namespace marram
