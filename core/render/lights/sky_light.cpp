// SPDX-License-Identifier: Apache-2.0
#include "core/render/lights/sky_light.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr size_t sky_cells = 512;

// Simpson's rule over each cell; positive if the sky has light there.
Distribution1D table_of(const SkyLight& light) {
    std::vector<double> weights(sky_cells);
    const auto at = [&](double y) {
        return mean_of(sky_radiance(light, Vec3f(0.0F, static_cast<float>(y), 0.0F)));
    };
    for (size_t i = 0; i < sky_cells; ++i) {
        const double y0 = -1.0 + 2.0 * static_cast<double>(i) / sky_cells, step = 2.0 / sky_cells;
        weights[i] = (at(y0) + 4.0 * at(y0 + 0.5 * step) + at(y0 + step)) / 6.0;
    }
    return Distribution1D(weights);
}

} // namespace

std::vector<ParamSpec> sky_params() {
    using enum ParamType;
    constexpr double bright = brightest_light;
    return {{"zenith", color, "W/(m^2 sr)", "[0.25, 0.45, 0.9]", 0, bright, "", "radiance straight above"},
            {"horizon", color, "W/(m^2 sr)", "[0.8, 0.87, 0.95]", 0, bright, "", "radiance at the horizon"},
            {"ground", color, "W/(m^2 sr)", "[0.2, 0.18, 0.15]", 0, bright, "",
             "radiance of the land below the horizon"},
            {"haze", number, "", "0.01", 0, 1, "",
             "optical depth of the air straight down to the land; 0: a sharp horizon"},
            {"strength", number, "", "1", 0, bright, "", "factor on all three"},
            seen_by_camera_param()};
}

SkyLight make_sky(const ParamSet& params) {
    SkyLight sky;
    sky.zenith = color_of(params, "zenith");
    sky.horizon = color_of(params, "horizon");
    sky.ground = color_of(params, "ground");
    sky.haze = float(params.number("haze"));
    sky.strength = float(params.number("strength"));
    sky.visible = params.boolean("seen_by_camera");
    return sky;
}

Vec3f sky_radiance(const SkyLight& sky, const Vec3f& direction) {
    const float y = direction.y();
    Vec3f color;
    if (y >= 0.0F) {
        const float down = 1.0F - std::min(y, 1.0F);
        color = sky.horizon + (1.0F - down * down * down) * (sky.zenith - sky.horizon);
    } else {
        color = sky.horizon + std::exp(sky.haze / y) * (sky.ground - sky.horizon);
    }
    return sky.strength * color;
}

SkySampler::SkySampler(const SkyLight& light) : sky_(light), by_height_(table_of(light)) {}

double SkySampler::power(double) const { return pi * by_height_.total() / sky_cells; }

void SkySampler::sample(const Vec3d&, float, float a, float b, LightSample& sample) const {
    const Distribution1D::Choice at = by_height_.sample(b);
    const double y = -1.0 + 2.0 * (static_cast<double>(at.cell) + at.within) / sky_cells;
    const double sine = std::sqrt(std::max(0.0, 1.0 - y * y)), phi = 2.0 * pi * a;
    sample.direction = Vec3d(sine * std::cos(phi), y, sine * std::sin(phi)).cast<float>();
    sample.radiance = sky_radiance(sky_, sample.direction);
    sample.pdf = static_cast<float>(by_height_.probability(at.cell) * sky_cells / (4.0 * pi));
}

LightRadiance SkySampler::along_ray(const Vec3f& direction, bool camera_ray) const {
    if (camera_ray && !sky_.visible) return {};
    const double y = std::clamp(static_cast<double>(direction.y()), -1.0, 1.0);
    const size_t cell = std::min(static_cast<size_t>(0.5 * (y + 1.0) * sky_cells), sky_cells - 1);
    return {sky_radiance(sky_, direction),
            static_cast<float>(by_height_.probability(cell) * sky_cells / (4.0 * pi))};
}

} // namespace marram
