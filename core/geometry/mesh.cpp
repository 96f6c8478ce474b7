// SPDX-License-Identifier: Apache-2.0
// Vertex normals, and vertices at the same position.
#include "core/geometry/mesh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <limits>

namespace marram {

namespace {

using Triangle = std::array<uint32_t, 3>;

constexpr uint32_t none = ~0u;
constexpr size_t vertices_a_task = 4096;

// The corners (3 * triangle + k) at each welded vertex, in the triangles' order.
struct Fans {
    std::vector<uint64_t> begin; // positions.size() + 1
    std::vector<uint64_t> corners;
};

Fans fans_of(std::span<const uint32_t> first, std::span<const Triangle> triangles) {
    Fans fans{std::vector<uint64_t>(first.size() + 1, 0), std::vector<uint64_t>(triangles.size() * 3)};
    for (const Triangle& t : triangles)
        for (uint32_t v : t) ++fans.begin[first[v] + 1];
    for (size_t v = 0; v < first.size(); ++v) fans.begin[v + 1] += fans.begin[v];
    std::vector<uint64_t> next(fans.begin.begin(), fans.begin.end() - 1);
    for (size_t t = 0; t < triangles.size(); ++t)
        for (size_t k = 0; k < 3; ++k) fans.corners[next[first[triangles[t][k]]]++] = 3 * t + k;
    return fans;
}

// One corner of a triangle.
struct Corner {
    Vec3d normal = Vec3d::Zero(); // unit
    double angle = 0.0;           // 0: the triangle has no significant area
    double area = 0.0;            // twice the triangle's
};

Corner corner_at(std::span<const Vec3f> positions, const Triangle& t, size_t k) {
    const Vec3d p = positions[t[k]].cast<double>();
    const Vec3d a = positions[t[(k + 1) % 3]].cast<double>() - p;
    const Vec3d b = positions[t[(k + 2) % 3]].cast<double>() - p;
    Corner corner;
    const Vec3d cross = a.cross(b);
    corner.area = cross.norm();
    if (!(corner.area > 0.0)) return corner;
    corner.normal = cross / corner.area;
    // If the triangle is less high than a few rounding errors of its coordinates, its normal is noise, but an
    // obtuse corner would still give it the weight of half a circle: it gets none.
    const double longest = std::sqrt(std::max({a.squaredNorm(), b.squaredNorm(), (b - a).squaredNorm()}));
    const double rounding = p.cwiseAbs().maxCoeff() * double(std::numeric_limits<float>::epsilon());
    constexpr double roundings = 2.0;
    if (corner.area > roundings * rounding * longest) corner.angle = std::atan2(corner.area, a.dot(b));
    return corner;
}

Vec3f normal_at(std::span<const Vec3f> positions, std::span<const Triangle> triangles,
                std::span<const uint64_t> fan, uint32_t vertex) {
    Vec3d all = Vec3d::Zero(), own = Vec3d::Zero(), flat = Vec3d::Zero(), one = Vec3d::Zero();
    double weight = 0.0;
    for (uint64_t c : fan) {
        const Triangle& t = triangles[c / 3];
        const Corner corner = corner_at(positions, t, c % 3);
        weight += corner.angle;
        all += corner.angle * corner.normal;
        const bool is_own = t[c % 3] == vertex;
        if (is_own) own += corner.angle * corner.normal;
        if (is_own && corner.angle > 0.0 && one.isZero(0.0)) one = corner.normal;
        flat += corner.area * corner.normal;
    }
    constexpr double vanishing = 1e-6; // relative to the weights: less is rounding error
    for (const Vec3d& sum : {all, own})
        if (sum.norm() > vanishing * weight) return sum.normalized().cast<float>();
    if (!one.isZero(0.0)) return one.cast<float>();
    if (flat.norm() > 0.0) return (flat / flat.norm()).cast<float>();
    return Vec3f::UnitY();
}

} // namespace

// An open hash table over the positions' bits.
std::vector<uint32_t> weld(std::span<const Vec3f> positions) {
    const size_t slots = std::bit_ceil(positions.size() * 2 + 1);
    std::vector<uint32_t> table(slots, none);
    std::vector<uint32_t> first(positions.size());
    for (uint32_t v = 0; v < positions.size(); ++v) {
        const Vec3f p = positions[v] + Vec3f::Zero(); // -0 becomes 0
        uint64_t hash = 0;
        for (int axis = 0; axis < 3; ++axis) {
            hash = (hash ^ std::bit_cast<uint32_t>(p[axis])) * 0x9e3779b97f4a7c15ull; // golden ratio
            hash ^= hash >> 32;
        }
        size_t slot = hash & (slots - 1);
        while (table[slot] != none && positions[table[slot]] != positions[v]) slot = (slot + 1) & (slots - 1);
        if (table[slot] == none) table[slot] = v;
        first[v] = table[slot];
    }
    return first;
}

std::vector<Vec3f> vertex_normals(std::span<const Vec3f> positions, std::span<const Triangle> triangles) {
    const std::vector<uint32_t> first = weld(positions);
    const Fans fans = fans_of(first, triangles);
    std::vector<Vec3f> normals(positions.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, positions.size(), vertices_a_task),
                      [&](const auto& range) {
                          for (size_t v = range.begin(); v != range.end(); ++v) {
                              const uint64_t begin = fans.begin[first[v]], end = fans.begin[first[v] + 1];
                              const std::span<const uint64_t> fan(fans.corners.data() + begin, end - begin);
                              normals[v] = normal_at(positions, triangles, fan, uint32_t(v));
                          }
                      });
    return normals;
}

} // namespace marram
