// SPDX-License-Identifier: Apache-2.0
// Specular from a map is rounded to one of 17 levels, each with its own table. The steps are 1/16 of the
// maximum, which is not visible, and each level conserves energy exactly.
#include "shaders/surface.h"

namespace marram {

namespace {

constexpr int specular_levels = 16;

} // namespace

std::vector<ParamSpec> surface_params() {
    constexpr double any = std::numeric_limits<double>::infinity();
    std::vector<ParamSpec> params = {
        {"color", ParamType::color, "", "[0.5, 0.5, 0.5]", 0.0, 1.0, "", "reflectance of the base"},
        {"roughness", ParamType::number, "", "0.5", min_roughness, 1.0, "",
         "of the boundary: 0.03 polished, 1 matt"},
        {"specular", ParamType::number, "", "0.04", 0.0, 0.5, "",
         "reflectance of the coat at normal incidence: 0.02 water, 0.04 glass and plastic, 0 no coat"},
        {"roughness_map", ParamType::image, "", "none", -any, any, "uv",
         "image whose first channel multiplies roughness"},
        {"specular_map", ParamType::image, "", "none", -any, any, "uv",
         "image whose first channel multiplies specular"},
    };
    for (ParamSpec& spec : strand_color_params()) params.push_back(std::move(spec));
    return params;
}

SurfaceSettings read_surface(const ParamSet& params, const TextureOpener& open) {
    SurfaceSettings settings;
    settings.color = read_strand_color(params, open);
    settings.roughness = static_cast<float>(params.number("roughness"));
    settings.specular = static_cast<float>(params.number("specular"));
    settings.roughness_map = map_of(params, "roughness_map", TextureContent::data, open);
    settings.specular_map = map_of(params, "specular_map", TextureContent::data, open);
    const int levels = settings.specular_map ? specular_levels : 0;
    for (int i = 0; i <= levels; ++i) {
        const float share = levels > 0 ? static_cast<float>(i) / specular_levels : 1.0F;
        settings.gloss.emplace_back(ior_of_specular(share * settings.specular));
    }
    return settings;
}

CoatedBsdf surface_at(const SurfaceSettings& settings, const ShadingPoint& point) {
    const auto [uv, width, wrap] = map_place(settings.color, point);
    Vec3f color = color_at(settings.color, point);
    color = color.cwiseProduct(variation_factor(settings.color, point, color));
    float roughness = settings.roughness;
    if (settings.roughness_map) roughness *= settings.roughness_map->at(uv, width, wrap).x();
    roughness = std::max(roughness, static_cast<float>(min_roughness));
    size_t level = 0;
    float share = 1.0F;
    if (settings.specular_map) {
        level = static_cast<size_t>(
            std::lround(specular_levels * settings.specular_map->at(uv, width, wrap).x()));
        share = static_cast<float>(level) / specular_levels;
    }
    return coated(point, point.normal, color, Vec3f::Zero(),
                  {&settings.gloss[level], ior_of_specular(share * settings.specular), roughness});
}

} // namespace marram
