// SPDX-License-Identifier: Apache-2.0
// The camera's view of a frame, as needed to choose how exact geometry must be.
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace marram {

struct View {
    Vec3d position = Vec3d::Zero(), forward = -Vec3d::UnitZ(); // at shutter open; forward: unit
    std::vector<std::pair<Vec3d, Vec3d>> later{}; // of a moving camera: the same at other instants
    double cosine = 1.0;                          // of the angle from forward to the film's corners
    double pixel_angle = 0.0;                     // radians per pixel at the centre of the image
    // Metres along forward at which a tolerance in pixels equals BuildSettings::tolerance; 0: it is in metres
    // anywhere.
    double reference_depth = 0.0;

    // Factor by which lengths at p appear larger than at `reference_depth`. For a moving camera: the largest.
    // At most 1 for points out of view, which can only cast shadows.
    double enlarged(const Vec3d& p) const {
        if (reference_depth <= 0.0) return 1.0;
        double most = enlarged_from(p, position, forward);
        for (const auto& [from, ahead] : later) most = std::max(most, enlarged_from(p, from, ahead));
        return most;
    }

  private:
    double enlarged_from(const Vec3d& p, const Vec3d& from, const Vec3d& ahead) const {
        const Vec3d way = p - from;
        const double distance = way.norm(), depth = way.dot(ahead);
        // A point so close to the camera that float vertices cannot separate them has no position on the
        // film.
        const bool seen =
            depth >= cosine * distance && depth > std::numeric_limits<float>::epsilon() * reference_depth;
        return seen ? reference_depth / depth : reference_depth / std::max(distance, reference_depth);
    }
};

} // namespace marram
