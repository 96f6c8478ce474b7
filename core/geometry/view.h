// SPDX-License-Identifier: Apache-2.0
// What a frame's camera sees, as far as it decides how exactly geometry is made.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace marram {

struct View {
    Vec3d position = Vec3d::Zero(), forward = -Vec3d::UnitZ(); // as the shutter opens; forward: unit
    std::vector<std::pair<Vec3d, Vec3d>> later{}; // the same at other instants of a camera that moves
    double cosine = 1.0;                          // of the angle from there to the film's corners
    double pixel_angle = 0.0;                     // radians a pixel spans in the image's centre
    // Metres along forward at which a tolerance asked for in pixels is as many metres as BuildSettings says; 0: it is metres anywhere.
    double pixels_at = 0.0;

    // How often the metres that a tolerance allows at `pixels_at` look as large at p. What is not in view, and throws shadows at most,
    // never counts more than once. Of a camera that moves: where it looks largest.
    double enlarged(const Vec3d& p) const {
        if (pixels_at <= 0.0) return 1.0;
        double most = enlarged_from(p, position, forward);
        for (const auto& [from, ahead] : later) most = std::max(most, enlarged_from(p, from, ahead));
        return most;
    }

  private:
    double enlarged_from(const Vec3d& p, const Vec3d& from, const Vec3d& ahead) const {
        const Vec3d way = p - from;
        const double distance = way.norm(), depth = way.dot(ahead);
        // A point that float vertices cannot tell from the camera has no place on the film.
        const bool seen =
            depth >= cosine * distance && depth > std::numeric_limits<float>::epsilon() * pixels_at;
        return seen ? pixels_at / depth : pixels_at / std::max(distance, pixels_at);
    }
};

} // namespace marram
