// SPDX-License-Identifier: Apache-2.0
// Daylight (shaders/daylight.h) as two lights: an environment image of the sky, and the sun.
//
// The image has 1536 x 768 pixels of 0.23 degrees. Its bilinear interpolation error over uniformly
// distributed directions and its cost are in tests/unit/render/daylight_test.cpp.
#pragma once

#include "core/render/lights/environment_light.h"
#include "core/render/lights/sun_light.h"

#include "shaders/daylight.h"

#include <optional>

namespace marram {

struct DaylightLights {
    EnvironmentLight sky;
    std::optional<SunLight> sun; // none if it gives no light
};

DaylightLights daylight_lights(const DaylightSettings& settings, float strength);

std::vector<ParamSpec> daylight_params();
DaylightLights make_daylight(const ParamSet& params);

} // namespace marram
