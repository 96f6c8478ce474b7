// SPDX-License-Identifier: Apache-2.0
// surface: plain solid things, painted, plastic, stone or skin: a matt body under a glossy boundary. Colour, roughness and
// specular may come from images.
//
//   parameter      unit  default          meaning
//   color          1     [0.5, 0.5, 0.5]  share of light that the body returns
//   roughness      1     0.5              of the boundary: 0.03 polished ... 1 matt
//   specular       1     0.04             reflected by the boundary straight on: 0.02 water, 0.04 glass and plastic, 0 none
//   roughness_map  -     none             image whose first channel multiplies roughness
//   specular_map   -     none             image whose first channel multiplies specular
//   color_map, map_scale, root_color, tip_color, variation, tint, tint_color: as in diffuse
//
//   [[material]]
//   name = "stone"
//   type = "surface"
//   color_map = "../textures/hill.png"
//   roughness = 0.7
//
// In a scene, painted with an image: scenes/run scenes/golden/room.toml --set 'mesh.ball.material="paint"'
//
// Images are filtered over the pixel's footprint; their values are cut to 0 ... 1. They come before tint: where it is 1 all is tint_color. White loses nothing at any angle, roughness and specular; the
// model is reciprocal.
#pragma once

#include "shaders/coated.h"
#include "shaders/texture.h"

#include <vector>

namespace marram {

struct SurfaceSettings {
    StrandColor color;
    float roughness = 0.5F, specular = 0.04F;
    std::shared_ptr<const Texture> roughness_map, specular_map;
    // One table, where specular is the same everywhere; over a map, of evenly spaced speculars up to the greatest.
    std::vector<GlossTable> gloss;
};

std::vector<ParamSpec> surface_params();
// Throws InputError where an image cannot be read.
SurfaceSettings read_surface(const ParamSet& params, const TextureOpener& open);
CoatedBsdf surface_at(const SurfaceSettings& settings, const ShadingPoint& point);

} // namespace marram
