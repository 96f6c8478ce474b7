// SPDX-License-Identifier: Apache-2.0
// All lights of a scene, and the registry of their types.
//
// A light is a file of its own, <type>_light.h: what it is, its parameters, a description as a scene gives it, and a sampler made from
// that for rendering.
//
// To add a light: its file, and its place in LightDescription, LightSampler, sampler_of (lights.cpp does not compile without) and
// light_types().
#pragma once

#include "core/render/environment_light.h"
#include "core/render/mesh_light.h"
#include "core/render/sky_light.h"
#include "core/render/sun_light.h"

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
    // Adds to `more` what becomes a light of its own.
    LightDescription (*make)(const ParamSet& params, const LightImageReader& read,
                             std::vector<LightDescription>& more);
};

// All types, in the order in which help and messages list them. Lives as long as the program.
std::span<const LightType> light_types();

class Lights {
  public:
    Lights() = default;
    // The world must outlive the lights: emitting triangles are read from it.
    Lights(std::span<const LightDescription> descriptions, const World& world);

    bool empty() const { return choice_.empty(); }

    // One light and a point of it, seen from `from`: 3 uniform numbers.
    LightSample sample(const Vec3d& from, float time, const std::array<float, 3>& random) const;

    // What a ray that hits nothing sees of all lights at infinity. `weight(pdf)` is asked for each light with the density with which
    // sample() would have chosen the direction (0: never).
    template <typename Weight>
    Vec3f environment_radiance(const Vec3f& direction, bool camera_ray, Weight&& weight) const {
        Vec3f sum = Vec3f::Zero();
        for (const uint32_t light : infinite_) {
            const SeenLight seen = seen_at_infinity(light, direction, camera_ray);
            if (seen.pdf >= 0.0F) sum += seen.radiance * weight(seen.pdf);
        }
        return sum;
    }

    // What a ray sees of the emitting mesh that it has hit.
    SeenLight emitted(const SurfacePoint& point, const Vec3f& direction) const;

  private:
    SeenLight seen_at_infinity(uint32_t light, const Vec3f& direction, bool camera_ray) const;

    std::vector<LightSampler> samplers_;
    std::vector<uint32_t> infinite_;
    Distribution1D choice_;
};

} // namespace marram
