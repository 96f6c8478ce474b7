// SPDX-License-Identifier: Apache-2.0
#include "core/view/looks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <variant>

namespace marram {
namespace {

using nlohmann::json;

const Material& material_of(const Shot& shot, int material) {
    static const Material plain{DiffuseSettings{}, "", false};
    for (int turns = 0; material >= 0 && turns < 8; ++turns) { // blends of blends
        const Material& found = shot.materials.at(size_t(material));
        const auto* blend = std::get_if<BlendSettings>(&found.settings);
        if (!blend) return found;
        material = blend->materials[0];
    }
    return plain;
}

Vec3f albedo_at(const Material& material, const ShadingPoint& point) {
    const Vec3f color = albedo(bsdf_at(material, point));
    return color.allFinite() ? Vec3f(color.cwiseMax(0.0F).cwiseMin(1.0F)) : Vec3f::Constant(0.5F);
}

Vec3f strand_albedo(const Material& material, float u) {
    ShadingPoint point;
    point.fibre = true;
    point.strand_u = u;
    point.strand_hash = 0x8000'0000U; // the middle of its variation
    return albedo_at(material, point);
}

// Mean radiance of the lights at infinity but the sun, over the upper or lower half of directions, weighted
// by the cosine.
Vec3f mean_radiance(const Lights& lights, double up) {
    constexpr int rings = 8, around = 16;
    Vec3f sum = Vec3f::Zero();
    for (int i = 0; i < rings; ++i)
        for (int k = 0; k < around; ++k) {
            const double sin2 = (i + 0.5) / rings, phi = 2.0 * pi * (k + 0.5) / around;
            const Vec3d d(std::sqrt(sin2) * std::cos(phi), up * std::sqrt(1.0 - sin2),
                          std::sqrt(sin2) * std::sin(phi));
            sum += lights.environment_radiance(d.cast<float>(), false, [](float) { return 1.0F; });
        }
    return sum / float(rings * around);
}

} // namespace

StrandColors strand_colors(const Shot& shot, int material) {
    const Material& used = material_of(shot, material);
    return {strand_albedo(used, 0.0F), strand_albedo(used, 1.0F)};
}

Vec3f mesh_color(const Shot& shot, int material) {
    ShadingPoint point;
    point.uv = Vec2f(0.5F, 0.5F);
    point.uv_width = 1.0F;
    return albedo_at(material_of(shot, material), point);
}

json light_of(const Shot& shot) {
    const SunLight* sun = nullptr; // the strongest
    std::vector<LightDescription> others;
    for (const LightDescription& light : shot.lights)
        if (const auto* found = std::get_if<SunLight>(&light)) {
            if (!sun || found->irradiance.sum() > sun->irradiance.sum()) sun = found;
        } else if (!std::holds_alternative<MeshLight>(light)) {
            others.push_back(light);
        }
    json light = {{"sun", nullptr}};
    if (sun) {
        const Vec3d towards = sun->direction.normalized();
        light["sun"] = {{"direction", {towards.x(), towards.y(), towards.z()}},
                        {"color", json_of(sun->irradiance / float(pi))}};
    }
    World world; // without meshes that emit
    world.bounds = Box3f(Vec3f::Zero(), Vec3f::Ones());
    const Lights lights(others, world);
    light["sky"] = json_of(mean_radiance(lights, 1.0));
    light["ground"] = json_of(mean_radiance(lights, -1.0));
    return light;
}

} // namespace marram
