// SPDX-License-Identifier: Apache-2.0
// surface: opaque solids such as paint, plastic, stone or skin. A diffuse base under a rough dielectric coat.
// Colour, roughness and specular can be textured.
//
//   parameter      unit  default          meaning
//   color          1     [0.5, 0.5, 0.5]  reflectance of the base
//   roughness      1     0.5              roughness of the coat: 0.03 polished ... 1 matt
//   specular       1     0.04             reflectance of the coat at normal incidence: 0.02 water, 0.04 glass
//                                         and plastic, 0 no coat
//   roughness_map  -     none             image whose first channel multiplies roughness
//   specular_map   -     none             image whose first channel multiplies specular
//   color_map, map_scale, map_wrap, root_color, tip_color, variation, tint, tint_color: as in diffuse
//
//   [[material]]
//   name = "stone"
//   type = "surface"
//   color_map = "../textures/hill.png"
//   roughness = 0.7
//
// In a scene, painted with an image: scenes/run scenes/golden/room.toml --set 'mesh.ball.material="paint"'
//
// Images are filtered over the pixel footprint; their values are clamped to [0, 1]. The tint is applied after
// the images: at tint 1 the colour is tint_color. A white surface loses no energy at any angle, roughness or
// specular; the model is reciprocal.
#pragma once

#include "shaders/coated.h"
#include "shaders/texture.h"

#include <vector>

namespace marram {

struct SurfaceSettings {
    StrandColor color;
    float roughness = 0.5F, specular = 0.04F;
    std::shared_ptr<const Texture> roughness_map, specular_map;
    // Without a specular map: one table. With a map: tables for evenly spaced values from 0 to `specular`.
    std::vector<GlossTable> gloss;
};

std::vector<ParamSpec> surface_params();
// Throws InputError if an image cannot be read.
SurfaceSettings read_surface(const ParamSet& params, const TextureOpener& open);
CoatedBsdf surface_at(const SurfaceSettings& settings, const ShadingPoint& point);

} // namespace marram
