// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/math/vec.h"

namespace marram {

// The rotation that turns the direction of a into that of b by the shortest way; a and b are not zero. Where they are
// opposite, half a turn about an axis across a. Relative error a few units in the last place, and sqrt(2 epsilon) of the
// angle near half a turn, where 1 + cos(angle) cancels.
// The bits of Eigen's FromTwoVectors, which solves opposite vectors by a singular value decomposition: that takes a
// compiler five to ten seconds wherever it is used.
inline Eigen::Quaterniond shortest_rotation(const Vec3d& a, const Vec3d& b) {
    const Vec3d from = a.normalized();
    const Vec3d to = b.normalized();
    const Vec3d across = from.cross(to);
    const double cosine = to.dot(from);
    Eigen::Quaterniond rotation;
    if (cosine < -1.0 + Eigen::NumTraits<double>::dummy_precision()) {
        const double w2 = (1.0 + std::max(cosine, -1.0)) * 0.5;
        const Vec3d axis = across.squaredNorm() > 0.0 ? across.normalized() : from.unitOrthogonal();
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
