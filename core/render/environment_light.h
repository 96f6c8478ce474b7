// SPDX-License-Identifier: Apache-2.0
// Light: environment. An image all around, sampled by how bright it is where.
//
//   parameter    unit          default             meaning
//   file         -             required            latitude by longitude, twice as wide as high. Rows run from +y down; the
//                                                  middle column is where -z points, +x is to the right of it
//   strength     -             1                   factor on the image: numbers of the file are W/(m^2 sr)
//   rotation     deg           0                   about y: turns what is at -z towards -x
//
//   [[light]]
//   name = "studio"
//   type = "environment"
//   file = "../textures/studio.exr"
//   rotation = 30
//
// Sampled in square blocks of pixels by the integral of the bilinear interpolant over them, uniform in azimuth and cosine inside a block.
// A pixel's mean is (1 6 1)/8 in both directions, so that it is 0 only where the interpolant is. The coarser a table, the more of it
// stays in the fastest cache, so blocks are as large as the map allows: with pixels of radiance L_i and solid angle a_i in a block of
// L, a, an estimate of all of the map has the relative second moment
//   sum over blocks of L a sum(L_i^2 a_i / (L^2 a)) / sum(L a),
// 1 were the density exact, and may have 1 + table_variance. Shadows and shaders vary by far more.
#pragma once

#include "core/render/distribution.h"
#include "core/render/light_type.h"

namespace marram {

struct EnvironmentLight {
    LightImage image;
    double rotation = 0.0; // radians about y: turns the world's image from -z towards -x
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
    SeenLight seen(const Vec3f& direction, bool camera_ray) const;

  private:
    EnvironmentLight light_;
    uint32_t shift_ = 0; // blocks are 2^shift pixels each way
    size_t columns_ = 0; // of blocks
    Distribution2D by_block_;
    std::vector<double> cosines_;  // of the borders of the blocks' rows, from 1 to -1
    std::vector<float> densities_; // per solid angle, of each block
};

std::vector<ParamSpec> environment_params();
EnvironmentLight make_environment(const ParamSet& params, const LightImageReader& read);

} // namespace marram
