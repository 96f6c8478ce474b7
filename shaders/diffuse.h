// SPDX-License-Identifier: Apache-2.0
// diffuse: a matt surface that reflects evenly from both sides, and if thin lets light through evenly too:
// ground, stone, skin under fur, leaves, blades of grass. On round curves it shades the round fibre, on
// ribbons the flat one.
//
//   parameter     unit  default             meaning
//   color         1     [0.5, 0.5, 0.5]     share of light reflected
//   transmission  1     [0, 0, 0]           share of light that comes out on the other side; color + transmission <= 1
//   color_map     -     none                image whose colour multiplies color, by the uv of a surface, or of a strand's root
//   map_scale     1     [1, 1]              how often the image repeats over the unit square of uv
//   root_color    1     none                colour at the root of a strand; with tip_color it replaces color on strands
//   tip_color     1     none                colour at the tip
//   variation     1     0                   how much strands differ in brightness and hue, 0 ... 1
//   tint          -     "none"              attribute whose value 0 ... 1 blends towards tint_color; of a name (id)
//                                           each strand has a share of its own
//   tint_color    1     [0.35, 0.2, 0.08]   what it blends towards
//
//   [[material]]
//   name = "blade"
//   type = "diffuse"
//   color = [0.12, 0.28, 0.05]
//   transmission = [0.08, 0.2, 0.03]
//   variation = 0.3
//
// In a scene: scenes/run scenes/default.toml; tinted by what gusts bring: scenes/run scenes/figure2.toml
//
// Lambert, "Photometria", 1760: f = color / pi on the side the light comes from, transmission / pi on the
// other.
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
                             const TextureOpener& open); // throws InputError where color + transmission > 1

struct DiffuseBsdf {
    Vec3f normal;           // on wo's side
    Vec3f geometric_normal; // on wo's side
    Vec3f reflectance, transmittance;
    float reflect_probability;
};

DiffuseBsdf diffuse_at(const DiffuseSettings& settings, const ShadingPoint& point);
BsdfValue evaluate(const DiffuseBsdf& bsdf, const Vec3f& wi);
bool sample(const DiffuseBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const DiffuseBsdf& bsdf);

} // namespace marram
