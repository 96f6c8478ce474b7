// SPDX-License-Identifier: Apache-2.0
// Daylight (shaders/daylight.h) as lights that the integrator knows: an image of the sky, and the sun.
//
// The image is 1536 x 768, a pixel 0.23 degrees. What bilinear interpolation of it is off by, over directions drawn
// evenly, and its cost are in tests/unit/render/daylight_test.cpp.
#pragma once

#include "core/render/lights.h"

#include "shaders/daylight.h"

namespace marram {

struct DaylightLights {
    EnvironmentLight sky;
    SunLight sun;
};

DaylightLights daylight_lights(const DaylightSettings& settings, float strength);

} // namespace marram
