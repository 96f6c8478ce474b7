// SPDX-License-Identifier: Apache-2.0
// What a frame's camera sees, as far as it decides how exactly geometry is made.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <limits>

namespace marram {

struct View {
    Vec3d position = Vec3d::Zero(), forward = -Vec3d::UnitZ(); // forward: unit
    double cosine = 1.0;      // of the angle from there to the film's corners
    double pixel_angle = 0.0; // radians a pixel spans in the image's centre
    // Metres along forward at which a tolerance asked for in pixels is as many metres as BuildSettings says; 0: it is metres anywhere.
    double pixels_at = 0.0;

    // How often the metres that a tolerance allows at `pixels_at` look as large at p. What is not in view, and throws shadows at most,
    // never counts more than once.
    double enlarged(const Vec3d& p) const {
        if (pixels_at <= 0.0) return 1.0;
        const Vec3d way = p - position;
        const double distance = way.norm(), depth = way.dot(forward);
        // A point that float vertices cannot tell from the camera has no place on the film.
        const bool seen =
            depth >= cosine * distance && depth > std::numeric_limits<float>::epsilon() * pixels_at;
        return seen ? pixels_at / depth : pixels_at / std::max(distance, pixels_at);
    }
};

} // namespace marram
