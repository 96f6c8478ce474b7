// SPDX-License-Identifier: Apache-2.0
// Meshes that become level sets, and those that are extracted from them. Without OpenVDB.
#include "procedural/erosion/level_mesh.h"

#include "core/math/vec.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace marram {
namespace {

constexpr double max_voxels = 0x1p27;       // in the band: 16 GB including temporary data during wear
constexpr double most_voxels_away = 0x1p17; // distance from the origin, where floats resolve 0.8 % of a voxel

Vec3d corner(std::span<const float> positions, std::span<const uint32_t> triangles, size_t n) {
    const float* const p = positions.data() + 3 * size_t(triangles[n]);
    return Vec3d(double(p[0]), double(p[1]), double(p[2]));
}

Vec3d corner(const LevelMesh& mesh, size_t n) { return corner(mesh.positions, mesh.triangles, n); }

// For each vertex the first vertex at the same position.
std::vector<uint32_t> first_vertex_at_position(std::span<const float> positions) {
    const size_t count = positions.size() / 3;
    std::vector<uint32_t> order(count), first(count);
    std::iota(order.begin(), order.end(), 0U);
    const auto key = [&](uint32_t v) {
        return std::array{positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]};
    };
    marram::parallel_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
        const auto ka = key(a), kb = key(b);
        return ka != kb ? ka < kb : a < b;
    });
    for (size_t n = 0; n < count; ++n)
        first[order[n]] = n > 0 && key(order[n]) == key(order[n - 1]) ? first[order[n - 1]] : order[n];
    return first;
}

// Throws unless every edge has an even number of triangles.
void check_closed(std::span<const uint32_t> triangles, const std::vector<uint32_t>& first) {
    std::vector<uint64_t> edges(triangles.size());
    for (size_t n = 0; n < triangles.size(); ++n) {
        const uint64_t a = first[triangles[n]], b = first[triangles[n % 3 == 2 ? n - 2 : n + 1]];
        edges[n] = std::min(a, b) << 32 | std::max(a, b);
    }
    marram::parallel_sort(edges.begin(), edges.end());
    for (size_t begin = 0, end; begin < edges.size(); begin = end) {
        for (end = begin; end < edges.size() && edges[end] == edges[begin];) ++end;
        const bool point = edges[begin] >> 32 == (edges[begin] & 0xffffffffU);
        if ((end - begin) % 2 != 0 && !point)
            throw LevelSetError("the mesh of the rock is open: an edge has triangles on one side only");
    }
}

} // namespace

std::vector<uint32_t> checked_triangles(std::span<const float> positions, std::span<const uint32_t> triangles,
                                        double voxel) {
    if (!(voxel > 0.0) || !std::isfinite(voxel)) throw LevelSetError("the voxel size must be above 0");
    if (positions.size() % 3 != 0 || triangles.size() % 3 != 0)
        throw LevelSetError("a vertex takes three floats, and a triangle three indices");
    if (positions.empty() || triangles.empty()) throw LevelSetError("the mesh of the rock is empty");
    if (positions.size() / 3 > std::numeric_limits<uint32_t>::max())
        throw LevelSetError("the mesh of the rock has too many vertices");
    for (const float p : positions)
        if (!std::isfinite(p)) throw LevelSetError("a vertex of the rock is not a number, or infinite");
    for (const uint32_t v : triangles)
        if (v >= positions.size() / 3)
            throw LevelSetError("a triangle of the rock names a vertex that is not there");
    check_closed(triangles, first_vertex_at_position(positions));

    std::vector<uint32_t> kept;
    kept.reserve(triangles.size());
    double area = 0.0;
    Vec3d lower = Vec3d::Constant(infinity), upper = -lower;
    for (size_t t = 0; t < triangles.size(); t += 3) {
        const std::array<Vec3d, 3> p{corner(positions, triangles, t), corner(positions, triangles, t + 1),
                                     corner(positions, triangles, t + 2)};
        const double twice = (p[1] - p[0]).cross(p[2] - p[0]).norm();
        if (!(twice > 0.0)) continue;
        area += 0.5 * twice;
        kept.insert(kept.end(), triangles.begin() + long(t), triangles.begin() + long(t) + 3);
        for (const Vec3d& q : p) lower = lower.cwiseMin(q), upper = upper.cwiseMax(q);
    }
    if (kept.empty()) throw LevelSetError("the mesh of the rock has no area");
    if (lower.cwiseAbs().cwiseMax(upper.cwiseAbs()).maxCoeff() > most_voxels_away * voxel)
        throw LevelSetError("the rock is more than 2^17 voxels from the origin: take larger voxels");
    if ((upper - lower).minCoeff() < voxel)
        throw LevelSetError("the voxels are larger than the rock: take smaller ones");
    if (area / (voxel * voxel) * 2.0 * level_set_band > max_voxels)
        throw LevelSetError("the rock takes more than 2^27 voxels: take larger ones");
    return kept;
}

std::vector<double> piece_volumes(const LevelMesh& mesh) {
    std::vector<uint32_t> parent(mesh.vertex_count());
    std::iota(parent.begin(), parent.end(), 0U);
    const auto root = [&](uint32_t v) {
        while (parent[v] != v) v = parent[v] = parent[parent[v]];
        return v;
    };
    for (size_t t = 0; t < mesh.triangles.size(); t += 3)
        for (const size_t c : {t + 1, t + 2}) {
            const uint32_t a = root(mesh.triangles[t]), b = root(mesh.triangles[c]);
            parent[std::max(a, b)] = std::min(a, b);
        }
    std::vector<double> volume(mesh.vertex_count(), 0.0);
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        volume[root(mesh.triangles[t])] +=
            corner(mesh, t).dot(corner(mesh, t + 1).cross(corner(mesh, t + 2))) / 6.0;
    }
    return volume;
}

bool has_quads(const LevelMesh& mesh) {
    const std::vector<uint32_t>& t = mesh.triangles;
    bool all = t.size() % 6 == 0;
    for (size_t k = 0; k < t.size() && all; k += 6) all = t[k] == t[k + 3] && t[k + 2] == t[k + 4];
    return all;
}

double mesh_area(const LevelMesh& mesh) {
    double sum = 0.0;
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const Vec3d p = corner(mesh, t);
        sum += 0.5 * (corner(mesh, t + 1) - p).cross(corner(mesh, t + 2) - p).norm();
    }
    return sum;
}

double mesh_volume(const LevelMesh& mesh) {
    double sum = 0.0;
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const Vec3d origin = corner(mesh, 0);
        sum += (corner(mesh, t) - origin)
                   .dot((corner(mesh, t + 1) - origin).cross(corner(mesh, t + 2) - origin)) /
               6.0;
    }
    return sum;
}

} // namespace marram
