// SPDX-License-Identifier: Apache-2.0
// The error of the sky's image, and its cost.
#include "core/render/lights/daylight_lights.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace marram {
namespace {

TEST(Daylight, ImageIsTheSkyAndLiesTheRightWayRound) {
    for (const double elevation : {40.0, 3.0, -3.0}) {
        DaylightSettings settings;
        const double e = elevation * degree, azimuth = 200.0 * degree;
        settings.direction = {std::cos(e) * std::sin(azimuth), std::sin(e), -std::cos(e) * std::cos(azimuth)};
        const auto start = std::chrono::steady_clock::now();
        const DaylightLights lights = daylight_lights(settings, 1.0F);
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
        const Daylight exact(settings);
        std::vector<double> errors;
        for (uint64_t i = 0; i < 2000; ++i) {
            const double y = 2.0 * unit_float(static_cast<uint32_t>(hash(7, i))) - 1.0;
            const double phi = 2.0 * pi * unit_float(static_cast<uint32_t>(hash(8, i)));
            const double level = std::sqrt(1.0 - y * y);
            const Vec3d direction(level * std::cos(phi), y, level * std::sin(phi));
            const Vec3f a = environment_radiance(lights.sky, direction.cast<float>());
            const Vec3f b = exact.radiance(direction);
            errors.push_back(static_cast<double>((a - b).cwiseAbs().maxCoeff() / b.maxCoeff()));
        }
        std::ranges::sort(errors);
        std::printf("[ daylight ] sun at %g degrees: image off by %.1e in the median, %.1e at 99 %%, %.1e at "
                    "most; %.2f s\n",
                    elevation, errors[1000], errors[1980], errors.back(), seconds.count());
        EXPECT_LT(errors[1000], 1e-3);
        EXPECT_LT(errors[1980], 0.02);
        // Above the blurred horizon the bound holds everywhere.
        const Vec3f sun = settings.direction.cast<float>();
        EXPECT_LT((environment_radiance(lights.sky, sun) - exact.radiance(settings.direction))
                      .cwiseAbs()
                      .maxCoeff(),
                  0.02F * exact.radiance(settings.direction).maxCoeff());
    }
}

} // namespace
} // namespace marram
