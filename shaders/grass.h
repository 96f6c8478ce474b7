// SPDX-License-Identifier: Apache-2.0
// grass: a thin blade, lit from both sides. Light that its waxy coat does not reflect is scattered inside. A
// fraction is transmitted and filtered towards yellow by the leaf, which is why grass glows against the sun.
// Blades are folded along the middle, so that their two halves catch the light differently. Round curves are
// shaded as round fibres, meshes as leaves.
//
//   parameter           unit  default             meaning
//   color               1     [0.16, 0.26, 0.06]  reflectance + transmittance of the base, before the filter
//   transmission        1     0.45                fraction of it that is transmitted
//   transmission_color  1     [1, 0.95, 0.45]     additional filter of the transmitted light
//   roughness           1     0.4                 roughness of the coat: 0.03 wet ... 1 matt
//   specular            1     0.03                reflectance of the coat at normal incidence; 0: no gloss
//   fold                deg   20                  rotation of the normal at the blade's edges; strands only
//   color_map, map_scale, map_wrap, root_color, tip_color, variation, tint, tint_color: as in diffuse
//
//   [[material]]
//   name = "blade"
//   type = "grass"
//   root_color = [0.2, 0.18, 0.07]
//   tip_color = [0.2, 0.3, 0.07]
//   variation = 0.4
//
// In a scene: scenes/run scenes/dune.toml
//
// Measured leaves reflect 5 to 10 % of visible light and transmit as much in green; the surface alone
// reflects 2 to 4 % (Woolley, "Reflectance and Transmittance of Light by Leaves", 1971). White without gloss
// or filter loses no energy at any angle; the model is reciprocal.
#pragma once

#include "shaders/coated.h"

#include <vector>

namespace marram {

struct GrassSettings {
    StrandColor color;
    float transmission = 0.45F, roughness = 0.4F, ior = 1.42F;
    float fold = 0.0F; // radians
    Vec3f transmission_color = Vec3f::Ones();
    GlossTable gloss;
};

std::vector<ParamSpec> grass_params();
GrassSettings read_grass(const ParamSet& params, const TextureOpener& open);
CoatedBsdf grass_at(const GrassSettings& settings, const ShadingPoint& point);

} // namespace marram
