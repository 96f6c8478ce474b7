// SPDX-License-Identifier: Apache-2.0
// One light is chosen per sample. Half of the probability is distributed evenly over the lights that emit,
// and half by an estimate of the irradiance that each causes in the scene, so no light is undersampled. Pdfs
// are per solid angle and include the probability of the choice.
#include "core/render/lights/lights.h"

#include "core/render/lights/daylight_lights.h"

#include <type_traits>

namespace marram {

std::span<const LightType> light_types() {
    using More = std::vector<LightDescription>;
    static const std::vector<LightType> types = {
        {"sun", "a disc at infinity", sun_params(),
         [](const ParamSet& params, const LightImageReader&, More&) -> LightDescription {
             return make_sun(params);
         }},
        {"sky", "a gradient over the whole sphere", sky_params(),
         [](const ParamSet& params, const LightImageReader&, More&) -> LightDescription {
             return make_sky(params);
         }},
        {"daylight", "sun and sky, computed from what the air is made of; white is sunlight above the air",
         daylight_params(),
         [](const ParamSet& params, const LightImageReader&, More& more) -> LightDescription {
             DaylightLights lights = make_daylight(params);
             if (lights.sun) more.emplace_back(*lights.sun);
             return std::move(lights.sky);
         }},
        {"environment", "an image around the scene, latitude by longitude", environment_params(),
         [](const ParamSet& params, const LightImageReader& read, More&) -> LightDescription {
             return make_environment(params, read);
         }},
        {"mesh", "a mesh that shines", mesh_light_params(),
         [](const ParamSet& params, const LightImageReader&, More&) -> LightDescription {
             return make_mesh_light(params);
         }},
    };
    return types;
}

namespace {

LightSampler sampler_of(const SunLight& light, uint32_t, const World&) { return SunSampler(light); }
LightSampler sampler_of(const SkyLight& light, uint32_t, const World&) { return SkySampler(light); }
LightSampler sampler_of(const EnvironmentLight& light, uint32_t, const World&) {
    return EnvironmentSampler(light);
}
LightSampler sampler_of(const MeshLight& light, uint32_t index, const World& world) {
    return MeshSampler(light, index, world);
}

bool is_at_infinity(const LightSampler& sampler) {
    return std::visit([](const auto& s) { return std::decay_t<decltype(s)>::at_infinity; }, sampler);
}

} // namespace

Lights::Lights(std::span<const LightDescription> descriptions, const World& world) {
    for (uint32_t i = 0; i < descriptions.size(); ++i) {
        samplers_.push_back(
            std::visit([&](const auto& light) { return sampler_of(light, i, world); }, descriptions[i]));
        if (is_at_infinity(samplers_.back())) infinite_.push_back(i);
    }
    const double size =
        world.bounds.isEmpty() ? 1.0 : 0.5 * static_cast<double>(world.bounds.diagonal().norm());
    const double radius = size > 0.0 ? size : 1.0;
    std::vector<double> powers;
    double total = 0.0;
    for (const LightSampler& sampler : samplers_)
        total += powers.emplace_back(std::visit([&](const auto& s) { return s.power(radius); }, sampler));
    if (!(total > 0.0)) return; // no light emits
    for (double& p : powers) p = p > 0.0 ? 0.5 / static_cast<double>(powers.size()) + 0.5 * p / total : 0.0;
    choice_ = Distribution1D(powers);
}

LightSample Lights::sample(const Vec3d& from, float time, const std::array<float, 3>& random) const {
    const Distribution1D::Choice choice = choice_.sample(random[0]);
    LightSample sample;
    std::visit([&](const auto& s) { s.sample(from, time, random[1], random[2], sample); },
               samplers_[choice.cell]);
    sample.pdf *= static_cast<float>(choice_.probability(choice.cell));
    sample.rr_u = static_cast<float>(choice.within);
    return sample;
}

LightRadiance Lights::infinite_light_radiance(uint32_t light, const Vec3f& direction, bool camera_ray) const {
    LightRadiance along_ray = std::visit(
        [&](const auto& s) {
            if constexpr (std::decay_t<decltype(s)>::at_infinity)
                return s.along_ray(direction, camera_ray);
            else
                return LightRadiance{};
        },
        samplers_[light]);
    const float chosen = empty() ? 0.0F : static_cast<float>(choice_.probability(light));
    if (along_ray.pdf >= 0.0F) along_ray.pdf = chosen * along_ray.pdf;
    return along_ray;
}

LightRadiance Lights::emitted(const SurfacePoint& point, const Vec3f& direction) const {
    if (point.light < 0 || static_cast<size_t>(point.light) >= samplers_.size() || empty()) return {};
    const auto light = static_cast<size_t>(point.light);
    const auto* mesh = std::get_if<MeshSampler>(&samplers_[light]);
    return mesh ? mesh->along_ray(point, direction, choice_.probability(light)) : LightRadiance{};
}

} // namespace marram
