// SPDX-License-Identifier: Apache-2.0
#include "shaders/shader.h"

namespace marram {

std::span<const ShaderDescription> shaders() {
    static const std::vector<ShaderDescription> all = {
        {"diffuse", "matt surface or thin leaf: even reflection, even transmission", diffuse_params()},
        {"hair", "rough dielectric fibre with coloured highlights: hair, fur, dry grass", hair_params()},
    };
    return all;
}

Material make_material(std::string_view type, const ParamSet& params) {
    Material material;
    assert((type == "diffuse" || type == "hair") && "types are checked where scenes are read");
    if (type == "hair")
        material.settings = read_hair(params);
    else
        material.settings = read_diffuse(params);
    const std::string& tint = params.text("tint");
    material.tint = tint == "none" ? "" : tint;
    return material;
}

Bsdf bsdf_at(const Material& material, const ShadingPoint& point) {
    if (const HairSettings* hair = std::get_if<HairSettings>(&material.settings))
        return hair_at(*hair, point);
    return diffuse_at(*std::get_if<DiffuseSettings>(&material.settings), point);
}

BsdfValue evaluate(const Bsdf& bsdf, const Vec3f& wi) {
    if (const HairBsdf* hair = std::get_if<HairBsdf>(&bsdf)) return evaluate(*hair, wi);
    return evaluate(*std::get_if<DiffuseBsdf>(&bsdf), wi);
}

bool sample(const Bsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    if (const HairBsdf* hair = std::get_if<HairBsdf>(&bsdf)) return sample(*hair, random, result);
    return sample(*std::get_if<DiffuseBsdf>(&bsdf), random, result);
}

Vec3f albedo(const Bsdf& bsdf) {
    if (const HairBsdf* hair = std::get_if<HairBsdf>(&bsdf)) return albedo(*hair);
    return albedo(*std::get_if<DiffuseBsdf>(&bsdf));
}

} // namespace marram
