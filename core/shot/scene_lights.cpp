// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene_lights.h"

#include "core/image/image.h"
#include "core/render/daylight_lights.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {
namespace {

Vec3f vec3f(const ParamSet& params, std::string_view name) { return params.vec3(name).cast<float>(); }

// The sky is returned, its sun goes to `suns`.
LightDescription daylight_of(const ParamSet& params, std::vector<LightDescription>& suns) {
    DaylightSettings settings;
    settings.direction = params.vec3("direction").stableNormalized();
    settings.angle = params.number("angle") * degree;
    settings.turbidity = params.number("turbidity");
    settings.ozone = params.number("ozone");
    settings.altitude = params.number("altitude");
    settings.ground_albedo = params.number("ground_albedo");
    DaylightLights lights = daylight_lights(settings, float(params.number("strength")));
    if (params.boolean("sun") && lights.sun.irradiance.maxCoeff() > 0.0F) suns.emplace_back(lights.sun);
    return std::move(lights.sky);
}

} // namespace

LightDescription make_light(const Item& item, std::vector<LightDescription>& suns,
                            std::vector<std::string>& warnings) {
    const ParamSet& params = item.params;
    if (item.type == "daylight") return daylight_of(params, suns);
    if (item.type == "sun") {
        SunLight sun;
        sun.direction = params.vec3("direction");
        sun.angle = params.number("angle") * degree;
        sun.irradiance = vec3f(params, "irradiance");
        return sun;
    }
    if (item.type == "sky") {
        SkyLight sky;
        sky.zenith = vec3f(params, "zenith");
        sky.horizon = vec3f(params, "horizon");
        sky.ground = vec3f(params, "ground");
        sky.strength = float(params.number("strength"));
        return sky;
    }
    if (item.type == "environment") {
        const std::string& file = params.text("file");
        const Image image = read_image(file);
        if (image.width / 2 != image.height && (image.width + 1) / 2 != image.height)
            throw InputError(params.at("file").place,
                             fmt::format("\"{}\" is {} x {} pixels: all directions by longitude and latitude "
                                         "are twice as wide as high",
                                         file, image.width, image.height),
                             "convert it to a latitude-longitude map");
        EnvironmentLight light;
        light.width = uint32_t(image.width);
        light.height = uint32_t(image.height);
        size_t negative = 0;
        float brightest = 0.0F;
        for (size_t i = 0; i < size_t(image.width) * size_t(image.height); ++i) {
            const float* p = image.pixels.data() + i * size_t(image.channels);
            const Vec3f color = image.channels >= 3 ? Vec3f(p[0], p[1], p[2]) : Vec3f::Constant(p[0]);
            negative += color.minCoeff() < 0.0F;
            light.pixels.push_back(color.cwiseMax(0.0F));
            brightest = std::max(brightest, light.pixels.back().maxCoeff());
        }
        if (negative > 0)
            warnings.push_back(fmt::format("{}: \"{}\" has {} pixels that are below 0: they give no light",
                                           to_string(params.at("file").place), file, negative));
        constexpr float most = 1e15F; // its square is a float
        if (!(brightest * float(params.number("strength")) <= most))
            throw InputError(params.at("file").place,
                             fmt::format("\"{}\" is as bright as {:.3g} times strength, {:.0e} is allowed",
                                         file, brightest, most),
                             "mend its hot pixels, or use less strength");
        light.rotation = params.number("rotation") * degree;
        light.strength = float(params.number("strength"));
        return light;
    }
    MeshLight light;
    light.radiance = vec3f(params, "radiance");
    return light;
}

} // namespace marram
