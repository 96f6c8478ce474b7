// SPDX-License-Identifier: Apache-2.0
// Light: sky. A gradient over the whole sphere.
//
//   parameter    unit          default             meaning
//   zenith       W/(m^2 sr)    [0.25, 0.45, 0.9]   radiance straight above
//   horizon      W/(m^2 sr)    [0.8, 0.87, 0.95]   radiance at the horizon
//   ground       W/(m^2 sr)    [0.2, 0.18, 0.15]   radiance below the horizon
//   strength     -             1                   factor on all three
//
//   [[light]]
//   name = "sky"
//   type = "sky"
//   horizon = [0.9, 0.8, 0.7]
//
// Sampled with uniform azimuth and a height y from a table: equal steps of y are equal solid angles (Archimedes).
#pragma once

#include "core/render/distribution.h"
#include "core/render/light_type.h"

namespace marram {

// Radiance: zenith to horizon as 1 - (1 - y)^3 of the direction's height y (it changes fastest near the
// horizon), ground below, which the horizon blends into over the first 0.1 of -y. Alike colours give exactly
// that colour everywhere.
struct SkyLight {
    Vec3f zenith = Vec3f::Ones(), horizon = Vec3f::Ones(), ground = Vec3f::Ones();
    float strength = 1.0F;
    bool visible = true;
};

Vec3f sky_radiance(const SkyLight& sky, const Vec3f& direction);

class SkySampler {
  public:
    static constexpr bool at_infinity = true;
    explicit SkySampler(const SkyLight& light);
    double power(double scene_radius) const;
    void sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const;
    SeenLight seen(const Vec3f& direction, bool camera_ray) const;

  private:
    SkyLight sky_;
    Distribution1D by_height_;
};

std::vector<ParamSpec> sky_params();
SkyLight make_sky(const ParamSet& params);

} // namespace marram
