// SPDX-License-Identifier: Apache-2.0
// Wind shielding: strands behind a collider get less wind. See shield.cpp for the exact definition.
#pragma once

#include "procedural/abi/values.h"
#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/strands.h"

#include <optional>
#include <span>
#include <vector>

namespace marram {

struct Shielding {
    double shield = 1.0;                // fraction of the wind that a fully sheltered strand loses
    double offset = 0.0;                // m: distance upwind within which obstacles count
    bool per_cv = false;                // else one value a strand
    std::optional<double> wake;         // m behind the obstacle at which shelter has faded to 0
    std::optional<double> wake_heights; // the same, in heights of the obstacle
    double spread = 0.0;                // radians: half angle of the cone of rays; 0: one ray
    int rays = 8;                       // a CV, in the cone; 0: to be derived from the tolerance
};

std::span<const MarramParam> shielding_params();
std::optional<Shielding> read_shielding(const Values& values); // empty if the scene has no shielding

// Number of rays a CV (1 ... 1024) for which 99 % of the strands up to `length` metres long are within
// `tolerance` metres (> 0) of their position with infinitely many rays. `enough`: false if 1024 do not
// suffice. `turn`: the largest fraction of its angle that any segment turns by. The largest distance was
// fitted by
//
//     0.75 (1 - e^(-spread / 2.5 degrees)) length shield turn / rays^0.8
//
// which is 1.0 to 2.5 times the measured one (two grooms, cones of 4, 15 and 45 degrees, 8 to 256 rays). It
// is multiplied by 1.6 if each CV has its own shelter (per_cv), and by 2 for turn factors meant for many more
// segments than strands have (`reference_segments`). `marram measure` shows the fit on a scene.
int cone_rays(const Shielding& shielding, double length, double turn, bool many_reference_segments,
              double tolerance, bool& enough);

// Vertical extent of each mesh at the time of the colliders, [geometry ID]; the unit of wake_heights.
std::vector<double> obstacle_heights(const Colliders& colliders);

// strands.rest -> strands.shield: the sheltered fraction of each CV, the same for all CVs of a strand unless
// per_cv. `heights` is read only if wake_heights is given. Cost: one ray a CV (times `rays` with spread),
// traced 256 at a time.
void shield(const Shielding& shielding, const Vec3d& wind, const Colliders& colliders,
            std::span<const double> heights, Strands& strands);

// The rays of one strand, as shield() sends them, and what they find: for a user interface that shows them.
struct ShelterRay {
    uint32_t cv = 0;
    Vec3f from, to; // to: at a mesh, or `offset` upwind
    float shelter = 0.0F;
};
std::vector<ShelterRay> shelter_rays(const Shielding& shielding, const Vec3d& wind,
                                     const Colliders& colliders, std::span<const double> heights,
                                     const Strands& strand);

} // namespace marram
