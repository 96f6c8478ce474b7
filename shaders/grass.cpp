// SPDX-License-Identifier: Apache-2.0
// The fold rotates the normal about the blade's tangent t by `fold` times the offset h across the blade, away
// from the middle: n cos a + (t x n) sin a. h is measured along t x wo; t x n is the same direction, as n is
// on wo's side.
#include "shaders/grass.h"

namespace marram {

std::vector<ParamSpec> grass_params() {
    std::vector<ParamSpec> params = {
        {"color", ParamType::color, "", "[0.16, 0.26, 0.06]", 0.0, 1.0, "",
         "reflectance + transmittance of the base, before transmission_color"},
        {"transmission", ParamType::number, "", "0.45", 0.0, 1.0, "",
         "fraction of color that is transmitted"},
        {"transmission_color", ParamType::color, "", "[1, 0.95, 0.45]", 0.0, 1.0, "",
         "additional filter of the transmitted light"},
        {"roughness", ParamType::number, "", "0.4", min_roughness, 1.0, "",
         "of the boundary: 0.03 wet, 1 matt"},
        {"specular", ParamType::number, "", "0.03", 0.0, 0.5, "",
         "reflected by the boundary straight on; 0: no gloss"},
        {"fold", ParamType::number, "deg", "20", 0.0, 60.0, "",
         "rotation of the normal at the blade's edges; strands only"},
    };
    for (ParamSpec& spec : strand_color_params()) params.push_back(std::move(spec));
    return params;
}

GrassSettings read_grass(const ParamSet& params, const TextureOpener& open) {
    GrassSettings settings;
    settings.color = read_strand_color(params, open);
    settings.transmission = static_cast<float>(params.number("transmission"));
    settings.transmission_color = params.vec3("transmission_color").cast<float>();
    settings.roughness = static_cast<float>(params.number("roughness"));
    settings.ior = ior_of_specular(static_cast<float>(params.number("specular")));
    settings.fold = static_cast<float>(params.number("fold") * degree);
    settings.gloss = GlossTable(settings.ior);
    return settings;
}

CoatedBsdf grass_at(const GrassSettings& settings, const ShadingPoint& point) {
    Vec3f color = color_at(settings.color, point);
    color = color.cwiseProduct(variation_factor(settings.color, point, color));
    const Coat coat{&settings.gloss, settings.ior, settings.roughness};
    const Vec3f reflected = (1.0F - settings.transmission) * color,
                through = settings.transmission * color.cwiseProduct(settings.transmission_color);
    if (!point.flat || settings.fold == 0.0F) return coated(point, point.normal, reflected, through, coat);
    const float side = point.sidedness_normal.dot(point.wo) < 0.0F ? -1.0F : 1.0F;
    const Vec3f facing = side * point.normal;
    const float turn = settings.fold * std::clamp(point.h, -1.0F, 1.0F);
    ShadingPoint half = point; // each half is a plane: the two normals agree, no energy is lost
    half.normal = half.sidedness_normal =
        (std::cos(turn) * facing + std::sin(turn) * point.tangent.cross(facing)).normalized();
    return coated(half, half.normal, reflected, through, coat);
}

} // namespace marram
