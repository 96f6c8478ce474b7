// SPDX-License-Identifier: Apache-2.0
// sand: rough grains with mutual shadowing and interreflection, wind ripples, and a few facets that glint.
// Ripples and glints have a fixed size in the world. Detail below the pixel footprint is averaged, so that
// both fade with distance and do not flicker.
//
//   parameter         unit  default             meaning
//   color             1     [0.56, 0.42, 0.28]  reflectance of dry sand
//   roughness         1     0.8                 of the grains: 0 Lambertian ... 1 as flat as the full moon
//   ripple_height     m     0.008               height from trough to crest; 0: no ripples
//   ripple_length     m     0.11                wavelength, from crest to crest
//   ripple_direction  deg   0                   wind heading: 0 towards +x, 90 towards +z
//   sparkle           1     0.05                fraction of the surface that is glassy facets; 0: none
//   grain             m     0.0004              distance between grains
//   color_map, map_scale, map_wrap, root_color, tip_color, variation, tint, tint_color: as in diffuse
//
//   [[material]]
//   name = "dune"
//   type = "sand"
//   ripple_direction = 20
//
// In a scene: scenes/run scenes/dune.toml
//
// Ripples and glints are fixed in world space: they do not follow a moving mesh, which gives a warning.
//
// If a mesh has the attributes "ripples" and "ripple_wave", as a terrain with a ripples layer has, these
// ripples replace those of the material. They adapt to slopes, lee sides and thin sand, and are displaced
// near the camera.
//
// Shaded ripples only turn the normal, without shadows of their own. As they fade with distance the ground
// becomes brighter: by 3 % at a sun elevation of 30 degrees, by 6 % at 14. There are no ripples on slopes
// above 30 degrees; on inclines they bend downhill (R. Bagnold, "The Physics of Blown Sand and Desert Dunes",
// 1941: they are 7 to 14 cm long and 5 to 10 mm high, the lee side two to three times as steep). Without
// ripples, white loses no energy (1e-3; 1e-2 with sparkle 1). In the limit of many glints the model is
// reciprocal.
#pragma once

#include "shaders/gloss.h"
#include "shaders/shading_point.h"

#include <array>
#include <vector>

namespace marram {

struct SandSettings {
    StrandColor color;
    float roughness = 0.8F;
    float ripple_height = 0.0F, ripple_length = 0.11F;
    Vec2d ripple_direction = Vec2d::UnitX(); // in x and z
    RippleField ripples{RippleSettings{}};   // of that length and height
    float sparkle = 0.0F, grain = 0.0004F;
    float ior = 1.54F; // quartz
    GlossTable gloss;
};

// Mesh attributes that provide ripples (SurfaceRipples in shading_point.h), four components each.
inline constexpr std::array ripple_attributes = {"ripples", "ripple_wave"};

std::vector<ParamSpec> sand_params();
SandSettings read_sand(const ParamSet& params, const TextureOpener& open);

struct SandBsdf {
    const SandSettings* settings;       // outlives the closure
    Vec3f wo, normal, sidedness_normal; // both normals on wo's side
    Vec3f color, multiple_color;        // of single and of multiple scattering between grains
    float single, bend;                 // A and B in sand.cpp
    float albedo_o, mean_albedo;        // E(mu_o), <E>
    Microsurface facets;
    GlossTable::Row gloss;
    float through; // transmittance of the facets: 1 - sparkle E(mu_o)
    float gloss_probability;
    Vec3d position;
    float width; // m, footprint of the pixel on the surface
};

SandBsdf sand_at(const SandSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const SandBsdf& bsdf, const Vec3f& wi);
bool sample(const SandBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const SandBsdf& bsdf);

// Footprint of a pixel on the ground: its two axes in x and z, m. `away` points from or to the camera and is
// long at grazing angles.
struct Footprint {
    Vec2f across = Vec2f::Zero(), away = Vec2f::Zero();
};

// The slope of the ripples, d/dx and d/dz, that a pixel with this footprint resolves, and the variance of the
// slope that it does not resolve (`unresolved_variance`).
struct Ripple {
    Vec2f slope = Vec2f::Zero();
    float unresolved_variance = 0.0F;
};
Ripple ripple_at(const SandSettings& settings, const ShadingPoint& point, const Footprint& seen);

// Brightness of the facets in a footprint of `width` at `position`, relative to the limit of infinitely many
// facets; mean 1. `chance`: probability that a facet reflects from wo to wi.
float glint(const SandSettings& settings, const Vec3d& position, float width, const Vec3f& half,
            float chance);

} // namespace marram
