// SPDX-License-Identifier: Apache-2.0
// Light: sky. A sky that brightens or darkens towards the zenith, and land that haze hides at the horizon.
//
//   parameter       unit          default             meaning
//   zenith          W/(m^2 sr)    [0.25, 0.45, 0.9]   radiance straight above
//   horizon         W/(m^2 sr)    [0.8, 0.87, 0.95]   radiance at the horizon
//   ground          W/(m^2 sr)    [0.2, 0.18, 0.15]   radiance of the land, straight below
//   haze            -             0.01                optical depth of the air down to the land: more hides
//                                                     more of the land; 0: a sharp horizon
//   strength        -             1                   factor on all three
//   seen_by_camera  -             true                false: it lights the scene, but the camera does not see it
//
//   [[light]]
//   name = "sky"
//   type = "sky"
//   horizon = [0.9, 0.8, 0.7]
//
// Sampled with uniform azimuth and with the height y from a table: equal steps of y are equal solid angles
// (Archimedes).
#pragma once

#include "core/render/distribution.h"
#include "core/render/lights/light_type.h"

namespace marram {

// Radiance as a function of the height y of the direction. Above the horizon it blends from horizon to zenith
// by 1 - (1 - y)^3, which changes fastest near the horizon. Below, the land is seen through haze / -y of
// optical depth, the path's through level layers of air: its share is exp(-haze / -y), and horizon is what
// the air adds. An eye 100 m above the land in air of 30 km visibility (3.9 over its extinction, Koschmieder)
// has a haze of 0.013. If all colours are equal, the result is exactly that colour everywhere.
struct SkyLight {
    Vec3f zenith = Vec3f::Ones(), horizon = Vec3f::Ones(), ground = Vec3f::Ones();
    float strength = 1.0F, haze = 0.01F;
    bool visible = true;
};

Vec3f sky_radiance(const SkyLight& sky, const Vec3f& direction);

class SkySampler {
  public:
    static constexpr bool at_infinity = true;
    explicit SkySampler(const SkyLight& light);
    double power(double scene_radius) const;
    void sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const;
    LightRadiance along_ray(const Vec3f& direction, bool camera_ray) const;

  private:
    SkyLight sky_;
    Distribution1D by_height_;
};

std::vector<ParamSpec> sky_params();
SkyLight make_sky(const ParamSet& params);

} // namespace marram
