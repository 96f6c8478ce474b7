// SPDX-License-Identifier: Apache-2.0
// Inputs and outputs of shaders: the shading point, BSDF values and samples, and the colour of materials.
#pragma once

#include "core/math/params.h"
#include "core/math/ripples.h"
#include "core/math/vec.h"
#include "shaders/texture.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

namespace marram {

// Ripples that a mesh provides by its attributes; they replace the ripples of the material.
struct SurfaceRipples {
    Vec2f gradient = Vec2f::Zero(); // of the smooth ground, along x and z
    float shaded_fraction = 0.0F;   // fraction of the ripple height that shading adds
    float repose_angle = 0.6F;      // radians
    float wavelength = 0.0F, height = 0.0F, wind_heading = 0.0F,
          seed = 0.0F; // m, m, radians from +x to +z; wavelength 0: no ripples
};

struct ShadingPoint {
    Vec3f wo = Vec3f::UnitZ();               // unit, towards the viewer
    Vec3f sidedness_normal = Vec3f::UnitZ(); // unit; the sign of sidedness_normal . d is the side of d
    Vec3f normal = Vec3f::UnitZ();           // unit, shading normal
    Vec3f tangent = Vec3f::UnitX();          // fibres: unit, root to tip
    Vec2f uv = Vec2f::Zero();                // fibres: uv of the surface at the root
    Vec3d position = Vec3d::Zero();          // m, world space
    float footprint = 0.0F;                  // m: width of the ray cone, perpendicular to wo
    float uv_width = 0.0F;    // footprint in uv, along the surface; 0 if unknown, and on fibres
    bool uv_tiled = false;    // the mesh has uvs outside the unit square: images repeat over it
    bool fibre = false;       // false: a surface; strand_u, h and strand_hash are not used
    bool flat = false;        // fibres: a flat ribbon
    float h = 0.0F;           // fibres: offset across the width, -1 ... 1, along tangent x wo
    float strand_u = 0.0F;    // fibres: 0 root ... 1 tip
    uint32_t strand_hash = 0; // fibres: hash of the strand id
    float tint_weight = 0.0F; // value of Material::tint_attribute, 0 without one
    SurfaceRipples ripples;
};

struct BsdfValue {
    Vec3f value = Vec3f::Zero(); // f |cos|, 1/sr
    float pdf = 0.0F;            // 1/sr
};

struct BsdfSample {
    Vec3f wi = Vec3f::UnitZ();
    Vec3f value = Vec3f::Zero(); // f |cos|; the sample weight is value / pdf
    float pdf = 0.0F;
};

// The colour of a material: a gradient along the strand, a random variation between strands, and a tint by an
// attribute, which shows for example gusts and shelter. Every shader has these parameters:
//
//   color_map              -  none               image that multiplies color, or the gradient; by the uv of a
//                                                surface, on strands by the uv at the root
//   map_scale              1  [1, 1]             repeats of an image over the unit square of uv
//   map_wrap               -  auto               beyond the border of an image: clamp, repeat, or auto: repeat if
//                                                map_scale is given or the mesh has uvs outside the unit square
//   root_color, tip_color  1  none               colours at the ends of a strand, instead of color; linear
//                                                between
//   variation              1  0                  random difference between strands, 0 ... 1: each channel is
//                                                multiplied by 1 +- variation
//   tint                   -  "none"             attribute that controls the tint: shield, gust, envelope, id,
//                                                ... (marram info lists them). 0 keeps the colour, 1 gives
//                                                tint_color; ids are hashed to [0, 1]
//   tint_color             1  [0.35, 0.2, 0.08]  colour at tint 1
//
//   tint = "gust"
//   tint_color = [0.9, 0.2, 0.05]
//
// In a scene: scenes/run scenes/golden/fur.toml --set 'material.fur.tint="id"' --set
// 'material.fur.tint_color=[0.1,0.3,0.9]'
//
// Strands have attributes, and so do meshes from procedurals; on other meshes a tint is an error.
struct StrandColor {
    Vec3f color = Vec3f::Constant(0.5F);
    bool has_root = false, has_tip = false; // the gradient replaces `color`; an unset end is `color`
    Vec3f root = Vec3f::Zero(), tip = Vec3f::Zero();
    float variation = 0.0F;
    Vec3f tint_color = Vec3f::Zero();
    std::shared_ptr<const Texture> map; // or nullptr
    Vec2f map_scale = Vec2f::Ones();
    std::optional<Wrap> map_wrap; // none: auto
};

// The colour parameters of every shader: color_map, map_scale, map_wrap, root_color, tip_color, variation,
// tint, tint_color.
std::vector<ParamSpec> strand_color_params();
// Throws InputError if the image cannot be read.
StrandColor read_strand_color(const ParamSet& params, const TextureOpener& open);

// The image that a parameter names, or nullptr if it is not set.
std::shared_ptr<const Texture> map_of(const ParamSet& params, const char* name, TextureContent content,
                                      const TextureOpener& open);

// Lookup position in an image and filter width, both in uv.
struct MapPlace {
    Vec2f uv;
    float width;
    Wrap wrap;
};
inline MapPlace map_place(const StrandColor& color, const ShadingPoint& point) {
    const bool repeats = point.uv_tiled || color.map_scale != Vec2f::Ones();
    return {point.uv.cwiseProduct(color.map_scale), point.uv_width * color.map_scale.cwiseAbs().maxCoeff(),
            color.map_wrap.value_or(repeats ? Wrap::repeat : Wrap::clamp)};
}

// The colour at a point without variation: gradient along the strand, times the image, then tinted.
Vec3f color_at(const StrandColor& color, const ShadingPoint& point);

// The factor of the variation for this strand: each channel is in 1 +- variation, limited so that full *
// factor is at most 1. 1 on surfaces. `full` is the total reflectance and transmittance of the shader at this
// colour.
Vec3f variation_factor(const StrandColor& color, const ShadingPoint& point, const Vec3f& full);

// Samples a direction around `normal` with pdf cos / pi (Malley's method: project a uniform disc sample up).
inline Vec3f cosine_direction(const Vec3f& normal, float a, float b) {
    const float radius = std::sqrt(a), phi = static_cast<float>(2.0 * pi) * b;
    Vec3f tangent, bitangent;
    orthonormal_basis(normal, tangent, bitangent);
    return (radius * std::cos(phi) * tangent + radius * std::sin(phi) * bitangent +
            std::sqrt(1.0F - a) * normal)
        .normalized();
}

// Mean of the channels, for sampling probabilities.
inline float mean(const Vec3f& color) { return (color.x() + color.y() + color.z()) * (1.0F / 3.0F); }

} // namespace marram
