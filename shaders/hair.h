// SPDX-License-Identifier: Apache-2.0
// hair: a rough dielectric fibre that absorbs inside: hair and fur, dry grass. Light reflects off its cuticle
// (R), passes through (TT), comes back after one inner reflection (TRT: the coloured highlight) and what
// remains after more.
//
//   parameter            unit  default             meaning
//   pigment              -     "color"             what sets the absorption: "color" or "melanin"
//   color                1     [0.6, 0.45, 0.3]    colour that many such fibres together have
//   melanin              1     1.3                 pigment: 0 white, 0.3 blond, 1.3 brown, 8 black
//   melanin_redness      1     0                   share of it that is red (pheomelanin)
//   roughness            1     0.3                 along the fibre, 0 sharp ... 1 even
//   azimuthal_roughness  1     0.3                 around the fibre
//   tilt                 deg   2                   slope of the scales, which open to the tip
//   ior                  1     1.55                index of refraction
//   color_map, map_scale, root_color, tip_color, variation, tint, tint_color: as in diffuse; melanin has no gradient
//
//   [[material]]
//   name = "fur"
//   type = "hair"
//   color = [0.5, 0.33, 0.2]
//   roughness = 0.25
//
// In a scene: scenes/run scenes/fur.toml. Strands alone can have it: meshes are refused.
//
// Lobes hold the light that leaves a smooth cylinder, to 1e-6; what its inner interfaces polarise is left
// out, at most 0.06 of the light that came. The model is not reciprocal: exchanging wo and wi changes what a
// whole fibre passes on by 10 % on average at the defaults, 1 % at roughness 0.03, 24 % at 1 and 34 % at a
// tilt of 20 degrees; at one offset across the fibre, by 13 % at the defaults.
//
// Marschner et al., "Light Scattering from Human Hair Fibers", 2003; d'Eon et al., "An Energy-Conserving Hair
// Reflectance Model", 2011; Chiang et al., "A Practical and Controllable Hair and Fur Model for Production
// Path Tracing", 2016. hair.cpp opens with the formulas.
#pragma once

#include "core/math/float4.h"
#include "shaders/shading_point.h"

#include <vector>

namespace marram {

struct HairSettings {
    StrandColor color;
    float roughness = 0.3F, azimuthal_roughness = 0.3F;
    float tilt = 0.0F; // radians
    float ior = 1.55F;
    // Derived once.
    bool same_everywhere =
        false; // no gradient, variation or tint: this colour and absorption hold at every point
    Vec3f base_color = Vec3f::Zero(), base_absorption = Vec3f::Zero();
    Float4 variance{};                           // longitudinal, of R, TT, TRT, residual
    Float4 precision{};                          // 1 / v
    Float4 scale{};                              // 1 / (v (1 - exp(-2/v)))
    Float4 least{};                              // exp(-2/v)
    float logistic_scale = 0.0F;                 // azimuthal
    float logistic_norm = 0.0F;                  // its mass in one turn
    std::array<float, 3> sin_tilt{}, cos_tilt{}; // of 2^k tilt
};

std::vector<ParamSpec> hair_params();
HairSettings read_hair(const ParamSet& params, const TextureOpener& open);

struct HairBsdf {
    Vec3f axis, front, side; // tangent; wo across it; axis x front. phi counts from front towards side
    Vec3f color;
    float sin_theta_o, cos_theta_o;
    float gamma_o, gamma_t;
    float logistic_scale, logistic_norm;
    std::array<Vec3f, 4> attenuation;         // of each lobe
    Float4 probability;                       // of sampling each lobe
    Float4 variance, precision, scale, least; // as in the settings
    Float4 lobe_sin, lobe_cos;                // theta_o, tilted, of each lobe
    Float4 exit;                              // azimuth of each lobe, -pi ... pi; the residual has none
};

HairBsdf hair_at(const HairSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const HairBsdf& bsdf, const Vec3f& wi);
bool sample(const HairBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const HairBsdf& bsdf);

} // namespace marram
