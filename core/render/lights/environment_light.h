// SPDX-License-Identifier: Apache-2.0
// Light: environment. An image around the scene, importance-sampled by its radiance.
//
//   parameter       unit          default             meaning
//   file            -             required            latitude-longitude image, twice as wide as high. The top
//                                                     row is +y; the middle column is -z, with +x to its right
//   strength        -             1                   factor on the image, whose values are W/(m^2 sr)
//   rotation        deg           0                   about y, from -z towards -x
//   seen_by_camera  -             true                false: it lights the scene, but the camera does not see it
//
//   [[light]]
//   name = "studio"
//   type = "environment"
//   file = "../textures/studio.exr"
//   rotation = 30
//
// Sampled in square blocks of pixels, proportional to the integral of the bilinear interpolant over the
// block; within a block uniform in azimuth and in the cosine of the polar angle. The interpolant's mean over
// a pixel has the weights (1 6 1)/8 in both directions, so the pdf is 0 only where the interpolant is 0.
// Coarse tables fit better into the L1 cache, so blocks are as large as the map allows. With pixels of
// radiance L_i and solid angle a_i in a block of radiance L and solid angle a, an estimate of the integral
// over the map has the relative second moment
//   sum over blocks of L a sum(L_i^2 a_i / (L^2 a)) / sum(L a).
// It is 1 for an exact pdf, and at most 1 + table_variance is allowed: shadows and BSDFs vary far more.
#pragma once

#include "core/render/distribution.h"
#include "core/render/lights/light_type.h"

namespace marram {

struct EnvironmentLight {
    LightImage image;
    double rotation = 0.0; // radians about y, from -z towards -x
    float strength = 1.0F;
    bool visible = true;
};

Vec3f environment_radiance(const EnvironmentLight& light, const Vec3f& direction);

class EnvironmentSampler {
  public:
    static constexpr bool at_infinity = true;
    explicit EnvironmentSampler(const EnvironmentLight& light);
    double power(double scene_radius) const;
    void sample(const Vec3d& from, float time, float a, float b, LightSample& sample) const;
    LightRadiance along_ray(const Vec3f& direction, bool camera_ray) const;

  private:
    EnvironmentLight light_;
    uint32_t shift_ = 0; // blocks are 2^shift pixels wide and high
    size_t columns_ = 0; // number of blocks in a row
    Distribution2D by_block_;
    std::vector<double> cosines_;  // polar-angle cosines of the block row borders, from 1 to -1
    std::vector<float> densities_; // pdf of each block, per solid angle
};

std::vector<ParamSpec> environment_params();
EnvironmentLight make_environment(const ParamSet& params, const LightImageReader& read);

} // namespace marram
