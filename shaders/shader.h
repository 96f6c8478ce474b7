// SPDX-License-Identifier: Apache-2.0
// The registry of shaders: what there is, with every parameter, and the three things a path tracer asks of
// one.
//
// A shader is a page of its own: <name>.h with what it models and how it is used, <name>.cpp with the
// derivation. To add one: write its page, add its closure to Bsdf, its settings to Material and a row to shader.cpp.
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
    bool strands_only = false; // has no meaning on a mesh
};

// All shaders, in the order of Material's settings. Lives as long as the program.
std::span<const ShaderDescription> shaders();

// A shader with its settings. `tint` names the attribute whose value colours, "" where there is none:
// whoever shades looks its value up and puts it into ShadingPoint::tint. A blend is no shader of its own: whoever shades looks up its
// attribute and goes on with one of its materials.
struct Material {
    std::variant<DiffuseSettings, GrassSettings, HairSettings, SandSettings, SurfaceSettings, BlendSettings>
        settings;
    std::string tint;
    bool mapped = false; // its looks come from images: strands need the uv at their roots
};

// Throws InputError where values are right one by one but not together (energy is never created), and where an image
// cannot be opened.
Material make_material(std::string_view type, const ParamSet& params, const TextureOpener& open);

// A shader at a point, everything that does not depend on the incident direction computed. Made on the stack.
// It may point into the material, which is no blend.
using Bsdf = std::variant<DiffuseBsdf, CoatedBsdf, HairBsdf, SandBsdf>;
Bsdf bsdf_at(const Material& material, const ShadingPoint& point);

// f(wo, wi) |cos| of the incident direction wi (unit, away from the point), and the solid-angle density of
// sampling it.
BsdfValue evaluate(const Bsdf& bsdf, const Vec3f& wi);

// Draws wi with that density from 4 uniform numbers. False where the point absorbs everything.
bool sample(const Bsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);

// The share of light that comes back under uniform light, an estimate for denoisers: colours as the artist
// set them.
Vec3f albedo(const Bsdf& bsdf);

} // namespace marram
