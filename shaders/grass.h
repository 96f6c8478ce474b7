// SPDX-License-Identifier: Apache-2.0
// grass: a thin blade, lit on both sides. What is not reflected by its waxy boundary is scattered inside; a share of that comes
// out on the other side, yellower for having gone through the leaf, which is why grass glows against the sun. Blades are folded along
// their middle, so that their two halves catch the light differently. On round curves it shades the round fibre, on meshes a
// leaf.
//
//   parameter           unit  default             meaning
//   color               1     [0.16, 0.26, 0.06]  share of the light inside that comes out again, on either side
//   transmission        1     0.45                of that, the share that comes out on the other side
//   transmission_color  1     [1, 0.95, 0.45]     what the light that goes through is filtered by besides
//   roughness           1     0.4                 of the boundary: 0.03 wet ... 1 matt
//   specular            1     0.03                reflected by the boundary straight on; 0: no gloss
//   fold                deg   20                  how far the halves of a blade are turned against each other; strands only
//   color_map, map_scale, root_color, tip_color, variation, tint, tint_color: as in diffuse
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
// The measure of real leaves: 5 to 10 % of visible light is reflected, in green as much goes through; the boundary alone reflects
// 2 to 4 % (Woolley, "Reflectance and Transmittance of Light by Leaves", 1971). White and without gloss or filter it loses
// nothing at any angle; it is reciprocal.
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
