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
    int rays = 8;                       // a CV, of the cone; 0: as many as the tolerance asks for
};

std::span<const MarramParam> shielding_params();
std::optional<Shielding> read_shielding(const Values& values); // nothing where the scene asks for none

// How many rays a CV the cone needs for 99 in 100 of strands no longer than `length` to stand within `tolerance` metres (> 0) of where
// they would with rays beyond number; 1 ... 1024, `enough`: whether that does. `turn`: no segment turns by more of its angle.
// Fitted: their greatest distance falls as
//     0.75 (1 - e^(-spread / 2.5 degrees)) length shield turn / rays^0.8
// which was 1.0 to 2.5 times what was seen (two grooms, cones of 4, 15 and 45 degrees, 8 to 256 rays). Shelter of each CV for itself
// is worth 1.6 of that, and turns made for many more segments than strands have (`reference_segments`) 2. `marram measure` shows
// the fit on a scene.
int cone_rays(const Shielding& shielding, double length, double turn, bool many_turns, double tolerance,
              bool& enough);

// Vertical extent of each mesh at the colliders' instant, [geometry ID]; what wake_heights counts in.
std::vector<double> obstacle_heights(const Colliders& colliders);

// strands.rest -> strands.shield: the sheltered share of each CV, the same for all CVs of a strand unless per_cv.
// `heights` is read only where wake_heights is given. Cost: one ray a CV (times `rays` with spread), traced 256 at a time.
void shield(const Shielding& shielding, const Vec3d& wind, const Colliders& colliders,
            std::span<const double> heights, Strands& strands);

} // namespace marram
