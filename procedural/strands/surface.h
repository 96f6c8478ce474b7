// SPDX-License-Identifier: Apache-2.0
// The mesh that strands grow on, at its bind pose and at the motion samples of a frame; and roots on it.
#pragma once

#include "core/math/hash.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// A root is a triangle and the number of a candidate on it. Everything else is hashed from these eight bytes,
// so the root also identifies the strand.
struct Root {
    uint32_t triangle, index;
};

// Uses of a root's hash. Each purpose gets an independent number.
enum class Purpose : uint32_t {
    place,
    priority,
    mask,
    length,
    comb,
    lean,
    arc,
    curl,
    frizz,
    width,
    id,
    clump,
    reach,
    share
};

inline uint64_t root_hash(uint32_t seed, Root root, Purpose purpose) {
    const uint64_t identity = (uint64_t(root.triangle) << 32) | root.index;
    return mix64(identity * 0x9e3779b97f4a7c15ULL ^ mix64((uint64_t(seed) << 32) | uint32_t(purpose)));
}

// Barycentric weights of a root, uniform over its triangle.
inline Vec3d root_weights(uint32_t seed, Root root) {
    const uint64_t h = root_hash(seed, root, Purpose::place);
    const double s = std::sqrt((double(uint32_t(h)) + 0.5) * 0x1p-32), t = (double(h >> 32) + 0.5) * 0x1p-32;
    return {1.0 - s, s * (1.0 - t), s * t};
}

// One pose of a mesh with the data that roots need. Pointers are borrowed.
struct Surface {
    const float* positions = nullptr; // xyz packed
    const float* normals = nullptr;   // nullptr: faceted
    const uint32_t* triangles = nullptr;
    const float* uvs = nullptr;
    uint32_t triangle_count = 0;
    std::span<const MarramAttribute> attributes{};

    // Value of an attribute with one number per vertex or face.
    double value(const MarramAttribute& attribute, uint32_t triangle, const Vec3d& weights) const {
        if (attribute.rate == MARRAM_PER_FACE) return double(attribute.values[triangle]);
        const uint32_t* t = triangles + 3 * size_t(triangle);
        double sum = 0.0;
        for (int i = 0; i < 3; ++i) sum += weights[i] * double(attribute.values[t[i]]);
        return sum;
    }
    Vec3d vertex(uint32_t i) const {
        return {double(positions[3 * size_t(i)]), double(positions[3 * size_t(i) + 1]),
                double(positions[3 * size_t(i) + 2])};
    }
    std::array<Vec3d, 3> corners(uint32_t triangle) const {
        const uint32_t* t = triangles + 3 * size_t(triangle);
        return {vertex(t[0]), vertex(t[1]), vertex(t[2])};
    }
    Vec3d point(uint32_t triangle, const Vec3d& weights) const {
        const auto p = corners(triangle);
        return weights[0] * p[0] + weights[1] * p[1] + weights[2] * p[2];
    }
    Vec2d uv(uint32_t triangle, const Vec3d& weights) const {
        if (!uvs) return Vec2d::Zero();
        Vec2d sum = Vec2d::Zero();
        for (int i = 0; i < 3; ++i) {
            const size_t at = 2 * size_t(triangles[3 * size_t(triangle) + size_t(i)]);
            sum += weights[i] * Vec2d(double(uvs[at]), double(uvs[at + 1]));
        }
        return sum;
    }
    // Unit directions of increasing u and v within a triangle; zero if its uv area is 0.
    std::array<Vec3d, 2> uv_directions(uint32_t triangle) const {
        const auto p = corners(triangle);
        const Vec2d origin = uv(triangle, Vec3d::UnitX()), a = uv(triangle, Vec3d::UnitY()) - origin,
                    b = uv(triangle, Vec3d::UnitZ()) - origin;
        const double area = a.x() * b.y() - a.y() * b.x(), sign = area < 0.0 ? -1.0 : 1.0;
        if (area == 0.0) return {Vec3d::Zero(), Vec3d::Zero()};
        const Vec3d u = sign * (b.y() * (p[1] - p[0]) - a.y() * (p[2] - p[0])),
                    v = sign * (a.x() * (p[2] - p[0]) - b.x() * (p[1] - p[0]));
        return {u.stableNormalized(), v.stableNormalized()};
    }
    double area(uint32_t triangle) const {
        const auto p = corners(triangle);
        return 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
    }
};

// The skin in the bind pose, which determines shape and comb, and at the requested time, which carries the
// strands.
struct SkinPoses {
    Surface bind, now;
};

// Orthonormal frame that moves with the surface: the normal, and a tangent along the triangle's first edge.
struct SurfaceFrame {
    Vec3d tangent, bitangent, normal;
};

// Unit normal of a triangle's plane. The triangle must have an area; roots are placed only on such triangles.
inline Vec3d plane_normal(const std::array<Vec3d, 3>& p) {
    return (p[1] - p[0]).cross(p[2] - p[0]).stableNormalized();
}

SurfaceFrame frame_at(const Surface& surface, uint32_t triangle, const Vec3d& weights);

// The rotation from the frame's coordinates to the world's: its columns are the axes.
inline Eigen::Matrix3d axes_of(const SurfaceFrame& frame) {
    Eigen::Matrix3d axes;
    axes << frame.tangent, frame.bitangent, frame.normal;
    return axes;
}

} // namespace marram
