// SPDX-License-Identifier: Apache-2.0
// diffuse: Lambertian reflection on both sides, and Lambertian transmission if the surface is thin: ground,
// stone, skin under fur, leaves, blades of grass. Round curves are shaded as round fibres, ribbons as flat
// ones.
//
//   parameter     unit  default             meaning
//   color         1     [0.5, 0.5, 0.5]     reflectance
//   transmission  1     [0, 0, 0]           transmittance; color + transmission <= 1
//   color_map     -     none                image that multiplies color; on strands by the uv at the root
//   map_scale     1     [1, 1]              repeats of the image over the unit square of uv
//   map_wrap      -     auto                beyond the border of an image: clamp, repeat, or auto: repeat if map_scale is
//                                           given or the mesh has uvs outside 0 ... 1
//   root_color    1     none                colour at the root of a strand; with tip_color it replaces color on strands
//   tip_color     1     none                colour at the tip
//   variation     1     0                   random difference between strands in brightness and hue, 0 ... 1
//   tint          -     "none"              attribute, 0 ... 1, that blends to tint_color; ids are hashed to [0, 1]
//   tint_color    1     [0.35, 0.2, 0.08]   colour at tint 1
//
//   [[material]]
//   name = "blade"
//   type = "diffuse"
//   color = [0.12, 0.28, 0.05]
//   transmission = [0.08, 0.2, 0.03]
//   variation = 0.3
//
// In a scene: scenes/run scenes/default.toml; tinted by gusts: scenes/run scenes/figure2.toml
//
// Lambert, "Photometria", 1760: f = color / pi on the side of the light, transmission / pi on the other.
#pragma once

#include "shaders/shading_point.h"

#include <vector>

namespace marram {

struct DiffuseSettings {
    StrandColor color;
    Vec3f transmission = Vec3f::Zero();
};

std::vector<ParamSpec> diffuse_params();
DiffuseSettings read_diffuse(const ParamSet& params,
                             const TextureOpener& open); // throws InputError if color + transmission > 1

struct DiffuseBsdf {
    Vec3f normal;           // on wo's side
    Vec3f sidedness_normal; // on wo's side
    Vec3f reflectance, transmittance;
    float reflect_probability;
};

DiffuseBsdf diffuse_at(const DiffuseSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const DiffuseBsdf& bsdf, const Vec3f& wi);
bool sample(const DiffuseBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const DiffuseBsdf& bsdf);

} // namespace marram
