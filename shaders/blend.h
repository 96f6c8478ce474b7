// SPDX-License-Identifier: Apache-2.0
// blend: two materials on one surface, or on the strands of one groom, by an attribute: rock that sand lies on, sand that is wet, fur
// that is tipped with snow.
//
//   parameter   unit  default            meaning
//   first       -     required           material where the ramp is 0
//   second      -     required           material where the ramp is 1; either may be a blend itself
//   attribute   -     required           attribute, of one number, of what the material is on
//   ramp        -     [[0, 0], [1, 1]]   share of the second material over the attribute
//
//   [[material]]
//   name = "ground"
//   type = "blend"
//   first = "rock"
//   second = "sand"
//   attribute = "sand"
//   ramp = { knots = [[0.01, 0], [0.05, 1]], interpolation = "smooth" }
//
// Each path meets one of the two, chosen by chance (as MixMaterial of Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed.,
// 10.5.1): the mean is the mixture s f_2 + (1 - s) f_1, no shader runs twice, and where the ramp is 0 or 1 there is no noise. Attributes
// come from procedurals; `marram info layers` names them.
#pragma once

#include "core/math/params.h"
#include "core/math/ramp.h"

#include <string>
#include <vector>

namespace marram {

struct BlendSettings {
    std::string names[2];  // of the materials
    int materials[2] = {}; // their indices in the scene, once all are known
    std::string attribute;
    Ramp ramp;
};

std::vector<ParamSpec> blend_params();
BlendSettings read_blend(const ParamSet& params);

// Which of the two a path meets: a share of paths, told apart by a number that is uniform in [0, 1).
inline int chosen(const BlendSettings& settings, double attribute, double uniform) {
    return settings.materials[uniform < settings.ramp(attribute) ? 1 : 0];
}

} // namespace marram
