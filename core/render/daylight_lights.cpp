// SPDX-License-Identifier: Apache-2.0
#include "core/render/daylight_lights.h"

#include <tbb/parallel_for.h>

namespace marram {

namespace {

// Height by the horizon, where the sky changes fastest; the width could be less but for the sun's aureole.
constexpr uint32_t image_width = 1536, image_height = 768;

} // namespace

DaylightLights daylight_lights(const DaylightSettings& settings, float strength) {
    const Loop in_parallel = [](size_t count, const std::function<void(size_t)>& body) {
        tbb::parallel_for(size_t{0}, count, body);
    };
    const Daylight daylight(settings, in_parallel);
    DaylightLights lights;
    EnvironmentLight& sky = lights.sky;
    sky.width = image_width;
    sky.height = image_height;
    sky.strength = strength;
    sky.rotation =
        -std::atan2(settings.direction.x(), -settings.direction.z()); // its centre column to the sun
    sky.pixels.resize(size_t{image_width} * image_height);
    in_parallel(image_height, [&](size_t row) {
        daylight.image_row(row, image_height, std::span(sky.pixels).subspan(row * image_width, image_width));
    });
    lights.sun = {settings.direction, settings.angle, strength * daylight.sun_irradiance(), true};
    return lights;
}

} // namespace marram
