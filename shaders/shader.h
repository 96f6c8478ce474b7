// SPDX-License-Identifier: Apache-2.0
// Registry of shaders: all shaders with their parameters, and what the path tracer calls: bsdf_at(),
// evaluate(), sample() and albedo().
//
// Each shader has its own files: <name>.h documents the model and its parameters, <name>.cpp the derivation.
// To add a shader: write these files, add its closure to Bsdf, its settings to Material and a row to
// shader.cpp.
#pragma once

#include "shaders/blend.h"
#include "shaders/diffuse.h"
#include "shaders/grass.h"
#include "shaders/hair.h"
#include "shaders/sand.h"
#include "shaders/surface.h"

#include <string>
#include <variant>
#include <vector>

namespace marram {

struct ShaderDescription {
    std::string name;
    std::string help; // one line
    std::vector<ParamSpec> params;
    bool strands_only = false; // not allowed on meshes
};

// All shaders, in the order of the alternatives of Material::settings. Static lifetime.
std::span<const ShaderDescription> shaders();

// A shader with its settings. tint_attribute names the attribute that tints the colour, "" for none: the
// integrator looks up its value and stores it in ShadingPoint::tint_weight. A blend has no BSDF: the
// integrator looks up its attribute and selects one of its two materials.
struct Material {
    std::variant<DiffuseSettings, GrassSettings, HairSettings, SandSettings, SurfaceSettings, BlendSettings>
        settings;
    std::string tint_attribute;
    bool mapped = false; // uses images: strands then need the uv at their roots
};

// Throws InputError if values are valid one by one but not together (they would create energy), or if an
// image cannot be opened.
Material make_material(std::string_view type, const ParamSet& params, const TextureOpener& open);

// A shader evaluated at a point: holds everything that does not depend on the incident direction. Lives on
// the stack and may point into the material. The material must not be a blend.
using Bsdf = std::variant<DiffuseBsdf, CoatedBsdf, HairBsdf, SandBsdf>;
Bsdf bsdf_at(const Material& material, const ShadingPoint& point);

// f(wo, wi) |cos| for the incident direction wi (unit, pointing away from the surface), and the pdf (solid
// angle) with which sample() generates it.
BsdfValue evaluate(const Bsdf& bsdf, const Vec3f& wi);

// Samples wi with that pdf from 4 uniform numbers. False if there is no valid sample, e.g. all light is
// absorbed.
bool sample(const Bsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);

// Albedo AOV for denoisers: an estimate of the hemispherical reflectance, close to the colours that the
// artist set.
Vec3f albedo(const Bsdf& bsdf);

} // namespace marram
