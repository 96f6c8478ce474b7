// SPDX-License-Identifier: Apache-2.0
// Light: sun. A disc at infinity.
//
//   parameter       unit          default             meaning
//   direction       -             [1, 2, 1]           towards the sun, of any length
//   angle           deg           0.53                angular diameter: larger makes shadows softer; 0: parallel
//                                                     rays, and the sun is invisible
//   irradiance      W/m^2         3                   on a surface perpendicular to it; 3.14 shows white as 1
//   seen_by_camera  -             true                false: it lights the scene, but the camera does not see it
//
//   [[light]]
//   name = "sun"
//   type = "sun"
//   direction = [-1, 2, 1]
//
// Sampled uniformly in the cone of half angle a. 1 - cos a is computed as 2 sin^2(a/2), which is accurate for
// small a; a direction at 1 - cos = w has sin = sqrt(w (2 - w)). Perpendicular irradiance E gives the
// radiance E / (pi sin^2 a). If float unit vectors cannot resolve the disc, the sun is a delta light.
#pragma once

#include "core/render/lights/light_type.h"

namespace marram {

struct SunLight {
    Vec3d direction = Vec3d::UnitY(); // towards the sun, any length
    double angle = 0.53 * degree;     // angular diameter, radians, 0 ... pi; 0: parallel rays, invisible
    Vec3f irradiance = Vec3f::Ones(); // W/m^2 on a plane that faces it, independent of `angle`
    bool visible = true;              // to camera rays
};

class SunSampler {
  public:
    static constexpr bool at_infinity = true;
    explicit SunSampler(const SunLight& light);
    double power(double scene_radius) const; // estimate of the irradiance it causes
    void sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const;
    LightRadiance along_ray(const Vec3f& direction, bool camera_ray) const;

  private:
    Vec3d direction_, x_, y_;           // orthonormal
    double half_angle_, one_minus_cos_; // one_minus_cos_: 1 - cos(half_angle_)
    Vec3f radiance_;                    // irradiance if delta_
    float pdf_ = 1.0F;
    bool delta_, visible_;
};

std::vector<ParamSpec> sun_params();
SunLight make_sun(const ParamSet& params);

} // namespace marram
