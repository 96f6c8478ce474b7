// SPDX-License-Identifier: Apache-2.0
// sand: grains that shade one another, wind ripples, and a few facets that glint. Ripples and glints are as large as they
// are in the world: what a pixel cannot resolve is averaged, so that both fade with the distance and do not flicker.
//
//   parameter         unit  default             meaning
//   color             1     [0.56, 0.42, 0.28]  share of light that dry sand returns
//   roughness         1     0.8                 of the grains: 0 even (Lambert) ... 1 as flat as the full moon
//   ripple_height     m     0.008               from trough to crest; 0: none
//   ripple_length     m     0.11                from crest to crest
//   ripple_direction  deg   0                   where the wind goes that made them: 0 along +x, 90 along +z
//   sparkle           1     0.05                share of the surface that is facets like glass; 0: none
//   grain             m     0.0004              from grain to grain
//   color_map, map_scale, root_color, tip_color, variation, tint, tint_color: as in diffuse
//
//   [[material]]
//   name = "dune"
//   type = "sand"
//   ripple_direction = 20
//
// In a scene: scenes/run scenes/dune.toml
//
// Both stay where they are in the world: under a mesh that moves they stay behind, of which there is a warning.
//
// A mesh that carries the attributes "ripples" and "ripple_wave", as a terrain with a layer of ripples does, has those ripples in place of the
// material's: they know of slopes, lees and thin sand, and near the camera they are displaced.
//
// Shaded ripples turn the normal only (their own shadows are left out); as they fade with the distance the ground becomes brighter, by 3 % where the sun
// is 30 degrees high, by 6 % at 14. None are where the ground is steeper than 30 degrees; on inclines
// they bend downhill (R. Bagnold, "The Physics of Blown Sand and Desert Dunes", 1941: they are 7 to 14 cm long and 5 to 10 mm high, the
// lee side two to three times as steep). Without ripples white loses nothing (1e-3; 1e-2 where all of it is
// facets), and where glints are beyond number the model is reciprocal.
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

// What a mesh that has ripples of its own calls them (SurfaceRipples in shading_point.h), four numbers each.
inline constexpr std::array ripple_attributes = {"ripples", "ripple_wave"};

std::vector<ParamSpec> sand_params();
SandSettings read_sand(const ParamSet& params, const TextureOpener& open);

struct SandBsdf {
    const SandSettings* settings;       // outlives the closure
    Vec3f wo, normal, geometric_normal; // both normals on wo's side
    Vec3f color, color_again;           // of light that left at once, and of what met several grains
    float single, bend;                 // A and B of sand.cpp
    float albedo_o, mean_albedo;        // E(mu_o), <E>
    Microsurface facets;
    GlossTable::Row gloss;
    float through; // of facets: 1 - share E(mu_o)
    float gloss_probability;
    Vec3d position;
    float width; // m, of what a pixel sees of the surface
};

SandBsdf sand_at(const SandSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const SandBsdf& bsdf, const Vec3f& wi);
bool sample(const SandBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const SandBsdf& bsdf);

// What a pixel sees of the ground: its two axes in x and z, m. Long ones are seen at grazing angles, away from the camera.
struct Footprint {
    Vec2f across = Vec2f::Zero(), away = Vec2f::Zero();
};

// The slope of the ripples' height, d/dx and d/dz, as far as a pixel of that footprint resolves it, and the variance of slope
// that it does not.
struct Ripple {
    Vec2f slope = Vec2f::Zero();
    float hidden = 0.0F;
};
Ripple ripple_at(const SandSettings& settings, const ShadingPoint& point, const Footprint& seen);

// How much brighter facets are, as seen by a pixel of `width` at the place, than facets beyond number would be; mean 1.
// `chance`: that a facet mirrors from wo to wi.
float glint(const SandSettings& settings, const Vec3d& position, float width, const Vec3f& half,
            float chance);

} // namespace marram
