// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/math/vec.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram {

// The rotation that turns the direction of a into that of b by the shortest way; a and b are not zero. Where they are
// opposite, half a turn about an axis across a.
// Errors, with e = 2^-52 and d = 1 + cos(angle), which cancels near half a turn: of the angle a few e / sqrt(d), at most
// sqrt(8 e) = 4e-8; of the quaternion's length a few e / d, at most 5e-4: normalise it where such errors add up.
// The bits of Eigen's FromTwoVectors but for opposite vectors (d < 1e-12), which that solves by a singular value
// decomposition: wherever it is used, it takes a compiler seconds.
inline Eigen::Quaterniond shortest_rotation(const Vec3d& a, const Vec3d& b) {
    const Vec3d from = a.normalized();
    const Vec3d to = b.normalized();
    const Vec3d across = from.cross(to);
    const double cosine = to.dot(from);
    Eigen::Quaterniond rotation;
    if (cosine < -1.0 + Eigen::NumTraits<double>::dummy_precision()) {
        const double w2 = (1.0 + std::max(cosine, -1.0)) * 0.5;
        // Below this `across` is mostly rounding, and need not be across.
        const bool is_known = across.squaredNorm() > std::numeric_limits<double>::epsilon();
        const Vec3d axis = is_known ? across.normalized() : from.unitOrthogonal();
        rotation.w() = std::sqrt(w2);
        rotation.vec() = axis * std::sqrt(1.0 - w2);
        return rotation;
    }
    const double s = std::sqrt((1.0 + cosine) * 2.0);
    rotation.vec() = across * (1.0 / s);
    rotation.w() = s * 0.5;
    return rotation;
}

} // namespace marram
