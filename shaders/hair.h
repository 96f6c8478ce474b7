// SPDX-License-Identifier: Apache-2.0
// hair: a rough dielectric fibre with absorption inside: hair, fur, dry grass. Lobes: reflection off the
// cuticle (R), transmission (TT), transmission with one internal reflection (TRT: the coloured highlight),
// and a residual for paths with more internal reflections.
//
//   parameter            unit  default             meaning
//   pigment              -     "color"             what sets the absorption: "color" or "melanin"
//   color                1     [0.6, 0.45, 0.3]    multiple-scattering colour of many such fibres
//   melanin              1     1.3                 pigment: 0 white, 0.3 blond, 1.3 brown, 8 black
//   melanin_redness      1     0                   fraction of red pigment (pheomelanin)
//   roughness            1     0.3                 longitudinal roughness, 0 sharp ... 1 uniform
//   azimuthal_roughness  1     0.3                 azimuthal roughness
//   tilt                 deg   2                   angle of the cuticle scales, which open towards the tip
//   ior                  1     1.55                index of refraction
//   color_map, map_scale, map_wrap, root_color, tip_color, variation, tint, tint_color: as in diffuse; melanin has no gradient
//
//   [[material]]
//   name = "fur"
//   type = "hair"
//   color = [0.5, 0.33, 0.2]
//   roughness = 0.25
//
// In a scene: scenes/run scenes/fur.toml. Only for strands: on a mesh it is an error.
//
// The lobes carry the energy that a smooth cylinder scatters, to 1e-6. Polarisation by the internal
// reflections is neglected, an error of at most 0.06 of the incident light. The model is not reciprocal:
// exchanging wo and wi changes the scattering of a whole fibre by 10 % on average at the defaults, 1 % at
// roughness 0.03, 24 % at 1 and 34 % at a tilt of 20 degrees; at one offset across the fibre, by 13 % at the
// defaults.
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
    // Derived from the parameters.
    bool same_everywhere =
        false; // no gradient, variation, map or tint: base_color and base_absorption hold everywhere
    Vec3f base_color = Vec3f::Zero(), base_absorption = Vec3f::Zero();
    Float4 variance{};                           // v, longitudinal: R, TT, TRT, residual
    Float4 precision{};                          // 1 / v
    Float4 scale{};                              // 1 / (v (1 - exp(-2/v)))
    Float4 exp_neg_2_over_v{};                   // exp(-2/v)
    float logistic_scale = 0.0F;                 // s, azimuthal
    float logistic_norm = 0.0F;                  // integral of the logistic over [-pi, pi]
    std::array<float, 3> sin_tilt{}, cos_tilt{}; // of 2^k tilt
};

std::vector<ParamSpec> hair_params();
HairSettings read_hair(const ParamSet& params, const TextureOpener& open);

struct HairBsdf {
    Vec3f axis, front, side; // tangent; wo projected across it; axis x front. phi is 0 at front, pi/2 at side
    Vec3f color;
    float sin_theta_o, cos_theta_o;
    float gamma_o, gamma_t;
    float logistic_scale, logistic_norm;
    std::array<Vec3f, 4> attenuation;                    // A_p of each lobe
    Float4 probability;                                  // of selecting each lobe
    Float4 variance, precision, scale, exp_neg_2_over_v; // as in the settings
    Float4 lobe_sin, lobe_cos;                           // sin and cos of theta_o, tilted for each lobe
    Float4 lobe_azimuth; // Phi_p of each lobe, -pi ... pi; not used for the residual
};

HairBsdf hair_at(const HairSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const HairBsdf& bsdf, const Vec3f& wi);
bool sample(const HairBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const HairBsdf& bsdf);

} // namespace marram
