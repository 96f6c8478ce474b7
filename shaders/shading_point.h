// SPDX-License-Identifier: Apache-2.0
// What a shader is told about a point, and what it answers with.
#pragma once

#include "core/math/params.h"
#include "core/math/ripples.h"
#include "core/math/vec.h"
#include "shaders/texture.h"

#include <algorithm>
#include <array>
#include <cstdint>

namespace marram {

// Ripples that a surface has of its own, as its attributes say.
struct SurfaceRipples {
    Vec2f gradient = Vec2f::Zero(); // of the ground along x and z, smooth
    float share = 0.0F;             // of their height that shading adds
    float repose = 0.6F;            // radians
    float wavelength = 0.0F, height = 0.0F, heading = 0.0F,
          seed = 0.0F; // m, m, radians from +x to +z; wavelength 0: there are none
};

struct ShadingPoint {
    Vec3f wo = Vec3f::UnitZ();               // unit, towards where the ray came from
    Vec3f geometric_normal = Vec3f::UnitZ(); // unit, either side
    Vec3f normal = Vec3f::UnitZ();           // unit, for shading
    Vec3f tangent = Vec3f::UnitX();          // fibres: unit, root to tip
    Vec2f uv = Vec2f::Zero();                // of a surface; fibres: of the surface at the root
    Vec3d position = Vec3d::Zero();          // m, in the world
    float footprint = 0.0F;                  // m: width of what the path stands for here, across wo
    float uv_width = 0.0F; // the same in uv, along the surface; 0 where it is not known, and on fibres
    bool fibre = false;    // false: a surface; strand_u, h and strand mean nothing there
    bool flat = false;     // fibres: a ribbon
    float h = 0.0F;        // fibres: offset across it, -1 ... 1, along tangent x wo
    float strand_u = 0.0F; // fibres: 0 root ... 1 tip
    uint32_t strand = 0;   // fibres: a hash of which strand it is
    float tint = 0.0F;     // value of the attribute that Material::tint names, 0 where there is none
    SurfaceRipples ripples;
};

struct BsdfValue {
    Vec3f value = Vec3f::Zero(); // f |cos|, 1/sr
    float pdf = 0.0F;            // 1/sr
};

struct BsdfSample {
    Vec3f wi = Vec3f::UnitZ();
    Vec3f value = Vec3f::Zero(); // f |cos|; the sample's weight is value / pdf
    float pdf = 0.0F;
};

// The colour of a material wherever it depends on the strand: along it, from strand to strand, and tinted by an attribute that
// the strand carries, as gusts and shelter are made visible. Every shader has these:
//
//   color_map              -  none               image whose colour multiplies color, or the gradient: by the uv of a surface, or of
//                                                the surface that a strand grows on, at its root
//   map_scale              1  [1, 1]             how often an image repeats over the unit square of uv
//   root_color, tip_color  1  none               colours at a strand's ends, instead of color; linear between
//   variation              1  0                  how much strands differ, 0 ... 1: channels by up to this share
//   tint                   -  "none"             the attribute: shield, gust, envelope, id, ... (marram info names them). 0 leaves the
//                                                colour, 1 makes it tint_color; of an id, each strand has a share of its own
//   tint_color             1  [0.35, 0.2, 0.08]
//
//   tint = "gust"
//   tint_color = [0.9, 0.2, 0.05]
//
// In a scene: scenes/run scenes/golden/fur.toml --set 'material.fur.tint="id"' --set 'material.fur.tint_color=[0.1,0.3,0.9]'. Strands
// carry attributes, and so do meshes that procedurals make; on others a tint is refused.
struct StrandColor {
    Vec3f color = Vec3f::Constant(0.5F);
    bool has_root = false, has_tip = false; // the gradient replaces `color`; a missing end is `color`
    Vec3f root = Vec3f::Zero(), tip = Vec3f::Zero();
    float variation = 0.0F;
    Vec3f tint_color = Vec3f::Zero();
    std::shared_ptr<const Texture> map; // or nullptr
    Vec2f map_scale = Vec2f::Ones();
};

// The parameters that colour has everywhere: color_map, map_scale, root_color, tip_color, variation, tint, tint_color.
std::vector<ParamSpec> strand_color_params();
// Throws InputError where the image cannot be read.
StrandColor read_strand_color(const ParamSet& params, const TextureOpener& open);

// The image that a parameter names, or nullptr where it is not given.
std::shared_ptr<const Texture> map_of(const ParamSet& params, const char* name, TextureContent content,
                                      const TextureOpener& open);

// Where an image is looked up at a point, and over which width.
struct MapPlace {
    Vec2f uv;
    float width;
};
inline MapPlace map_place(const StrandColor& color, const ShadingPoint& point) {
    return {point.uv.cwiseProduct(color.map_scale), point.uv_width * color.map_scale.cwiseAbs().maxCoeff()};
}

// The colour at a point before variation: gradient along the strand, times what the image has there, then tint.
Vec3f color_at(const StrandColor& color, const ShadingPoint& point);

// What variation multiplies this strand's colour by, each channel 1 +- variation, no channel of full * factor
// above 1; 1 on surfaces. `full` is all that the shader gives back where it has this colour.
Vec3f variation_factor(const StrandColor& color, const ShadingPoint& point, const Vec3f& full);

// Draws a direction around `normal` with density cos / pi (Malley's method: a uniform point of the disc, lifted).
inline Vec3f cosine_direction(const Vec3f& normal, float a, float b) {
    const float radius = std::sqrt(a), phi = static_cast<float>(2.0 * pi) * b;
    Vec3f tangent, bitangent;
    orthonormal_basis(normal, tangent, bitangent);
    return (radius * std::cos(phi) * tangent + radius * std::sin(phi) * bitangent +
            std::sqrt(1.0F - a) * normal)
        .normalized();
}

// For sampling.
inline float mean(const Vec3f& color) { return (color.x() + color.y() + color.z()) * (1.0F / 3.0F); }

} // namespace marram
