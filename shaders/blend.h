// SPDX-License-Identifier: Apache-2.0
// blend: mixes two materials by an attribute, on a mesh or on the strands of a groom: sand on rock, wet sand,
// fur with snow on its tips.
//
//   parameter   unit  default            meaning
//   first       -     required           material where the ramp is 0
//   second      -     required           material where the ramp is 1; both may be blends themselves
//   attribute   -     required           attribute of the mesh or groom, with one component
//   ramp        -     [[0, 0], [1, 1]]   fraction of the second material as a function of the attribute
//
//   [[material]]
//   name = "ground"
//   type = "blend"
//   first = "rock"
//   second = "sand"
//   attribute = "sand"
//   ramp = { knots = [[0.01, 0], [0.05, 1]], interpolation = "smooth" }
//
// Each path selects one of the two materials at random (as MixMaterial of Pharr, Jakob, Humphreys,
// "Physically Based Rendering", 4th ed., 10.5.1). The expected value is the mixture s f_2 + (1 - s) f_1, only
// one shader is evaluated, and there is no noise where the ramp is 0 or 1. Attributes come from procedurals;
// `marram info layers` lists them.
#pragma once

#include "core/math/params.h"
#include "core/math/ramp.h"

#include <string>
#include <vector>

namespace marram {

struct BlendSettings {
    std::string names[2];  // of the materials
    int materials[2] = {}; // their indices in the scene, set when all materials are read
    std::string attribute;
    Ramp ramp;
};

std::vector<ParamSpec> blend_params();
BlendSettings read_blend(const ParamSet& params);

// Index of the material that a path selects. `uniform` is a random number in [0, 1).
inline int select_material(const BlendSettings& settings, double attribute, double uniform) {
    return settings.materials[uniform < settings.ramp(attribute) ? 1 : 0];
}

} // namespace marram
