// SPDX-License-Identifier: Apache-2.0
// All lights of a scene, and the registry of their types.
//
// Each light type has its own file, <type>_light.h (daylight's are in daylight_lights.h), with its parameters, a description as given in a scene,
// and a sampler made from that for rendering.
//
// To add a light type: write its file, and add it to LightDescription, LightSampler, sampler_of (without it
// lights.cpp does not compile) and light_types().
#pragma once

#include "core/render/lights/environment_light.h"
#include "core/render/lights/mesh_light.h"
#include "core/render/lights/sky_light.h"
#include "core/render/lights/sun_light.h"

#include <array>
#include <span>
#include <variant>
#include <vector>

namespace marram {

using LightDescription = std::variant<SunLight, SkyLight, EnvironmentLight, MeshLight>;
using LightSampler = std::variant<SunSampler, SkySampler, EnvironmentSampler, MeshSampler>;

// A type of light in scene files.
struct LightType {
    std::string name, help;
    std::vector<ParamSpec> params;
    // Appends further lights to `more` if one description stands for several.
    LightDescription (*make)(const ParamSet& params, const LightImageReader& read,
                             std::vector<LightDescription>& more);
};

// All types, in the order of help and messages. The list is static.
std::span<const LightType> light_types();

class Lights {
  public:
    Lights() = default;
    // The world must outlive the lights: they read emitting triangles from it.
    Lights(std::span<const LightDescription> descriptions, const World& world);

    bool empty() const { return choice_.empty(); }

    // Samples a light and a point on it for the shading point `from`. random: three uniform numbers, the
    // first for the choice of the light, the other two for the point on it.
    LightSample sample(const Vec3d& from, float time, const std::array<float, 3>& random) const;

    // Radiance of all lights at infinity along a ray that hits nothing. `weight(pdf)` is called for each
    // light with the pdf with which sample() would sample the direction (0: never), and returns the MIS
    // weight.
    template <typename Weight>
    Vec3f environment_radiance(const Vec3f& direction, bool camera_ray, Weight&& weight) const {
        Vec3f sum = Vec3f::Zero();
        for (const uint32_t light : infinite_) {
            const LightRadiance along_ray = infinite_light_radiance(light, direction, camera_ray);
            if (along_ray.pdf >= 0.0F) sum += along_ray.radiance * weight(along_ray.pdf);
        }
        return sum;
    }

    // Radiance of the emitting mesh that a ray has hit.
    LightRadiance emitted(const SurfacePoint& point, const Vec3f& direction) const;

  private:
    LightRadiance infinite_light_radiance(uint32_t light, const Vec3f& direction, bool camera_ray) const;

    std::vector<LightSampler> samplers_;
    std::vector<uint32_t> infinite_;
    Distribution1D choice_;
};

} // namespace marram
