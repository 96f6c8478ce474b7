// SPDX-License-Identifier: Apache-2.0
// Lambert's law on both sides. With n on wo's side and c, t the two colours,
//
//   f |cos| = c / pi (n . wi)  above,  t / pi (-n . wi)  below.
//
// Sampling selects the side with probability mean(c) : mean(t), then a cosine-weighted direction (Malley's
// method: project a uniform disc sample up), so that for a grey material every sample weight is the albedo. f
// is 0 where n and sidedness_normal disagree about the side of wi (n may come from ripples): otherwise light
// would leak.
#include "shaders/diffuse.h"

#include "core/math/problem.h"

namespace marram {

namespace {

constexpr float inverse_pi = static_cast<float>(1.0 / pi);

void check_energy(const ParamSet& params, const char* name, const Vec3f& transmission) {
    const Vec3f sum = params.vec3(name).cast<float>() + transmission;
    constexpr float rounding = 1e-6F; // 0.7 + 0.3 in float may come out above 1
    if (!(sum.maxCoeff() > 1.0F + rounding)) return;
    throw InputError(
        params.at(name).place, std::string(name) + " + transmission is more than 1: light would be created",
        std::string("lower ") + name + " or transmission until no channel of their sum is above 1");
}

} // namespace

std::vector<ParamSpec> diffuse_params() {
    std::vector<ParamSpec> params = {
        {"color", ParamType::color, "", "[0.5, 0.5, 0.5]", 0.0, 1.0, "", "share of light reflected"},
        {"transmission", ParamType::color, "", "[0, 0, 0]", 0.0, 1.0, "",
         "share of light that comes out on the other side; color + transmission <= 1"},
    };
    for (ParamSpec& spec : strand_color_params()) params.push_back(std::move(spec));
    return params;
}

DiffuseSettings read_diffuse(const ParamSet& params, const TextureOpener& open) {
    DiffuseSettings settings;
    settings.color = read_strand_color(params, open);
    settings.transmission = params.vec3("transmission").cast<float>();
    check_energy(params, "color", settings.transmission);
    for (const char* name : {"root_color", "tip_color"})
        if (params.has(name)) check_energy(params, name, settings.transmission);
    if (params.text("tint") != "none") check_energy(params, "tint_color", settings.transmission);
    return settings;
}

DiffuseBsdf diffuse_at(const DiffuseSettings& settings, const ShadingPoint& point) {
    DiffuseBsdf bsdf;
    const float side = point.sidedness_normal.dot(point.wo) < 0.0F ? -1.0F : 1.0F;
    bsdf.normal = side * point.normal;
    bsdf.sidedness_normal = side * point.sidedness_normal;
    bsdf.reflectance = color_at(settings.color, point);
    bsdf.transmittance = settings.transmission;
    const Vec3f factor = variation_factor(settings.color, point, bsdf.reflectance + bsdf.transmittance);
    bsdf.reflectance = bsdf.reflectance.cwiseProduct(factor);
    bsdf.transmittance = bsdf.transmittance.cwiseProduct(factor);
    const float above = mean(bsdf.reflectance), below = mean(bsdf.transmittance);
    bsdf.reflect_probability = above + below > 0.0F ? above / (above + below) : 1.0F;
    return bsdf;
}

BsdfValue evaluate(const DiffuseBsdf& bsdf, const Vec3f& wi) {
    const float cosine = bsdf.normal.dot(wi);
    const bool above = cosine > 0.0F;
    BsdfValue result;
    const float density = std::abs(cosine) * inverse_pi;
    result.pdf = density * (above ? bsdf.reflect_probability : 1.0F - bsdf.reflect_probability);
    if ((bsdf.sidedness_normal.dot(wi) > 0.0F) == above)
        result.value = density * (above ? bsdf.reflectance : bsdf.transmittance);
    return result;
}

bool sample(const DiffuseBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    const float above = random[2] < bsdf.reflect_probability ? 1.0F : -1.0F;
    result.wi = cosine_direction(above * bsdf.normal, random[0], random[1]);
    const BsdfValue at = evaluate(bsdf, result.wi);
    result.value = at.value;
    result.pdf = at.pdf;
    return at.pdf > 0.0F && at.value.maxCoeff() > 0.0F;
}

Vec3f albedo(const DiffuseBsdf& bsdf) { return bsdf.reflectance + bsdf.transmittance; }

} // namespace marram
