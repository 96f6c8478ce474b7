// SPDX-License-Identifier: Apache-2.0
#include "core/render/lights/daylight_lights.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <vector>

namespace marram {

namespace {

// The height is needed near the horizon, where the sky changes fastest. The width is needed only for the
// aureole of the sun.
constexpr uint32_t image_width = 1536, image_height = 768;

} // namespace

namespace {

void in_parallel(size_t count, const std::function<void(size_t)>& body) {
    // Isolated: while a thread waits for the sky, it must not start tasks that wait for the sky as well.
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(size_t{0}, count, body); });
}

std::vector<Vec3f> sky_image(const DaylightSettings& settings) {
    const Daylight daylight(settings, in_parallel);
    std::vector<Vec3f> pixels(size_t{image_width} * image_height);
    in_parallel(image_height, [&](size_t row) {
        daylight.image_row(row, image_height, std::span(pixels).subspan(row * image_width, image_width));
    });
    return pixels;
}

} // namespace

DaylightLights daylight_lights(const DaylightSettings& settings, float strength) {
    DaylightLights lights;
    EnvironmentLight& sky = lights.sky;
    sky.image.width = image_width;
    sky.image.height = image_height;
    sky.image.pixels = SharedPixels([settings] { return sky_image(settings); });
    sky.strength = strength;
    // Turns the centre column towards the sun.
    sky.rotation = -std::atan2(settings.direction.x(), -settings.direction.z());
    const Vec3f irradiance =
        strength * sun_irradiance(settings, Atmosphere(air_of(settings), in_parallel, false));
    if (irradiance.maxCoeff() > 0.0F) lights.sun = {settings.direction, settings.angle, irradiance, true};
    return lights;
}

std::vector<ParamSpec> daylight_params() {
    using enum ParamType;
    constexpr double any = std::numeric_limits<double>::infinity();
    return {{"direction", vec3, "", "[1, 2, 1]", -longest_direction, longest_direction, "",
             "towards the sun, of any length; below the horizon: dusk, then black"},
            {"angle", number, "deg", "0.53", 0, 10, "", "the sun's angular diameter; larger: softer shadows"},
            {"sun", boolean, "", "true", -any, any, "", "false: the sky alone"},
            {"turbidity", number, "", "2.5", 1, 20, "",
             "haze: 1 pure air, 2 very clear, 3 clear, 6 hazy, 10 thick"},
            {"ozone", number, "DU", "300", 0, 1000, "", "makes dusk blue overhead; 100 to 500 on earth"},
            {"altitude", number, "m", "100", 0, 50000, "", "of the scene above the sea"},
            {"ground_albedo", color, "", "0.2", 0, 1, "",
             "share of light that the land around reflects, a number or a colour"},
            {"strength", number, "", "1", 0, brightest_light, "",
             "factor on everything; at 1 the sun above the air gives 5 W/m^2"},
            seen_by_camera_param()};
}

DaylightLights make_daylight(const ParamSet& params) {
    DaylightSettings settings;
    settings.direction = params.vec3("direction").stableNormalized();
    settings.angle = params.number("angle") * degree;
    settings.turbidity = params.number("turbidity");
    settings.ozone = params.number("ozone");
    settings.altitude = params.number("altitude");
    settings.ground_albedo = params.vec3("ground_albedo");
    DaylightLights lights = daylight_lights(settings, float(params.number("strength")));
    if (!params.boolean("sun")) lights.sun.reset();
    lights.sky.visible = params.boolean("seen_by_camera");
    if (lights.sun) lights.sun->visible = lights.sky.visible;
    return lights;
}

} // namespace marram
