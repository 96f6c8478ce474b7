// SPDX-License-Identifier: Apache-2.0
// Vector types: Eigen's fixed-size types under their usual names.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>
#include <numbers>

namespace marram {

using Vec2f = Eigen::Vector2f;
using Vec3f = Eigen::Vector3f;
using Vec4f = Eigen::Vector4f;
using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;
using Vec4d = Eigen::Vector4d;
using Box3f = Eigen::AlignedBox3f;

inline constexpr double pi = std::numbers::pi;
inline constexpr double infinity = std::numeric_limits<double>::infinity();
inline constexpr float pi_f = std::numbers::pi_v<float>;
inline constexpr double degree = pi / 180.0; // radians in a degree
inline constexpr double embree_limit =
    1e18; // of coordinates: Embree silently drops vertices slightly beyond it

// An orthonormal basis around a unit vector, without branches on direction and exact to rounding everywhere
// (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017).
template <typename Scalar>
inline void orthonormal_basis(const Eigen::Matrix<Scalar, 3, 1>& n, Eigen::Matrix<Scalar, 3, 1>& tangent,
                              Eigen::Matrix<Scalar, 3, 1>& bitangent) {
    const Scalar sign = std::copysign(Scalar(1), n.z());
    const Scalar a = Scalar(-1) / (sign + n.z());
    const Scalar b = n.x() * n.y() * a;
    tangent = {Scalar(1) + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
    bitangent = {b, sign + n.y() * n.y() * a, -n.y()};
}

} // namespace marram
