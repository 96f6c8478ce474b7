// SPDX-License-Identifier: Apache-2.0
#include "shaders/shader.h"

namespace marram {

namespace {

Bsdf at(const DiffuseSettings& settings, const ShadingPoint& point) { return diffuse_at(settings, point); }
Bsdf at(const GrassSettings& settings, const ShadingPoint& point) { return grass_at(settings, point); }
Bsdf at(const HairSettings& settings, const ShadingPoint& point) { return hair_at(settings, point); }
Bsdf at(const SandSettings& settings, const ShadingPoint& point) { return sand_at(settings, point); }
Bsdf at(const SurfaceSettings& settings, const ShadingPoint& point) { return surface_at(settings, point); }
Bsdf at(const BlendSettings&, const ShadingPoint& point) {
    assert(false && "a blend is one of its materials by now");
    return diffuse_at({}, point);
}

} // namespace

std::span<const ShaderDescription> shaders() {
    static const std::vector<ShaderDescription> all = {
        {"diffuse", "matt surface or thin leaf: even reflection, even transmission", diffuse_params()},
        {"grass", "thin glossy blade that light shines through", grass_params()},
        {"hair", "rough dielectric fibre with coloured highlights: hair, fur, dry grass", hair_params(),
         true},
        {"sand", "rough grains with wind ripples and glints", sand_params()},
        {"surface", "matt body under a glossy boundary, with images: stone, paint, plastic, skin",
         surface_params()},
        {"blend", "one of two materials, by an attribute: rock and sand, dry and wet", blend_params()},
    };
    return all;
}

Material make_material(std::string_view type, const ParamSet& params, const TextureOpener& open) {
    Material material;
    if (type == "diffuse") material.settings = read_diffuse(params, open);
    if (type == "grass") material.settings = read_grass(params, open);
    if (type == "hair") material.settings = read_hair(params, open);
    if (type == "sand") material.settings = read_sand(params, open);
    if (type == "surface") material.settings = read_surface(params, open);
    if (type == "blend") material.settings = read_blend(params);
    assert(shaders()[material.settings.index()].name == type && "types are checked where scenes are read");
    for (const char* map : {"color_map", "roughness_map", "specular_map"})
        material.mapped = material.mapped || params.has(map);
    if (!params.has("tint")) return material;
    const std::string& tint = params.text("tint");
    if (tint.empty())
        throw InputError(params.at("tint").place, "tint is empty", "name an attribute, or leave it out");
    material.tint_attribute = tint == "none" ? "" : tint;
    return material;
}

Bsdf bsdf_at(const Material& material, const ShadingPoint& point) {
    return std::visit([&](const auto& settings) { return at(settings, point); }, material.settings);
}

BsdfValue evaluate(const Bsdf& bsdf, const Vec3f& wi) {
    return std::visit([&](const auto& closure) { return evaluate(closure, wi); }, bsdf);
}

bool sample(const Bsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    return std::visit([&](const auto& closure) { return sample(closure, random, result); }, bsdf);
}

Vec3f albedo(const Bsdf& bsdf) {
    return std::visit([](const auto& closure) { return albedo(closure); }, bsdf);
}

} // namespace marram
