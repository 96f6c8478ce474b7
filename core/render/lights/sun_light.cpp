// SPDX-License-Identifier: Apache-2.0
#include "core/render/lights/sun_light.h"

#include "core/math/float4.h"

namespace marram {
namespace {

constexpr double min_disc = 64.0 * 0x1p-23; // radians; a float direction has an error of up to 1 % of it

} // namespace

std::vector<ParamSpec> sun_params() {
    using enum ParamType;
    return {{"direction", vec3, "", "[1, 2, 1]", -longest_direction, longest_direction, "",
             "towards the sun, of any length"},
            {"angle", number, "deg", "0.53", 0, 180, "", "angular diameter; larger: softer shadows"},
            {"irradiance", color, "W/m^2", "3", 0, brightest_light, "",
             "on a surface perpendicular to it; 3.14 shows white as 1"},
            seen_by_camera_param()};
}

SunLight make_sun(const ParamSet& params) {
    SunLight sun;
    sun.direction = params.vec3("direction");
    sun.angle = params.number("angle") * degree;
    sun.irradiance = color_of(params, "irradiance");
    sun.visible = params.boolean("seen_by_camera");
    return sun;
}

SunSampler::SunSampler(const SunLight& light)
    : direction_(light.direction.normalized()), half_angle_(0.5 * light.angle),
      one_minus_cos_(2.0 * std::sin(0.5 * half_angle_) * std::sin(0.5 * half_angle_)),
      radiance_(light.irradiance), delta_(half_angle_ < min_disc), visible_(light.visible) {
    orthonormal_basis(direction_, x_, y_);
    if (delta_) return;
    radiance_ = light.irradiance / static_cast<float>(pi * std::sin(half_angle_) * std::sin(half_angle_));
    pdf_ = static_cast<float>(1.0 / (2.0 * pi * one_minus_cos_));
}

double SunSampler::power(double) const {
    const double sine = std::sin(half_angle_);
    return mean_of(radiance_) * (delta_ ? 1.0 : pi * sine * sine);
}

void SunSampler::sample(const Vec3d&, float, float a, float b, LightSample& sample) const {
    sample.delta = delta_;
    sample.radiance = radiance_;
    sample.pdf = pdf_;
    const double w = delta_ ? 0.0 : one_minus_cos_ * a;
    const double sine = std::sqrt(w * (2.0 - w));
    Float4 sin_phi, cos_phi;
    fast_sin_cos(Float4{} + static_cast<float>(2.0 * pi) * b, sin_phi, cos_phi);
    sample.direction = (sine * (double(cos_phi[0]) * x_ + double(sin_phi[0]) * y_) + (1.0 - w) * direction_)
                           .normalized()
                           .cast<float>();
}

LightRadiance SunSampler::along_ray(const Vec3f& direction, bool camera_ray) const {
    const bool inside = (direction.cast<double>() - direction_).squaredNorm() <= 2.0 * one_minus_cos_;
    if (delta_ || !inside || (camera_ray && !visible_)) return {};
    return {radiance_, pdf_};
}

} // namespace marram
