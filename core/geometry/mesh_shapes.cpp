// SPDX-License-Identifier: Apache-2.0
// The built-in meshes. Every triangle is anticlockwise seen from outside.
#include "core/geometry/embree_buffer.h"
#include "core/geometry/mesh.h"
#include "core/math/problem.h"

#include <fmt/format.h>

namespace marram {

namespace {

using Triangle = std::array<uint32_t, 3>;

[[noreturn]] void refuse(const char* mesh, const std::string& what, const std::string& fix) {
    throw InputError(Place{std::string(mesh) + " mesh"}, what, fix);
}

void check_size(const char* mesh, const char* name, double value) {
    if (!(value > 0.0 && value <= embree_limit))
        refuse(mesh, fmt::format("{} is {}", name, value), "give a finite size above 0");
}

void check_divisions(const char* mesh, int divisions, uint64_t triangles) {
    if (divisions < 1) refuse(mesh, fmt::format("divisions is {}", divisions), "give at least 1");
    if (triangles > max_count / 2)
        refuse(mesh, fmt::format("{} divisions make {} triangles", divisions, triangles),
               "use fewer divisions");
}

void finish(Mesh& mesh) {
    reserve_spare_bytes(mesh.positions);
    reserve_spare_bytes(mesh.normals);
    reserve_spare_bytes(mesh.uvs);
    reserve_spare_bytes(mesh.triangles);
}

// Vertices of a grid over the xz plane, columns along x and rows along z, at height 0.
Mesh grid(Vec2f size, uint32_t columns, uint32_t rows) {
    Mesh mesh;
    mesh.positions.reserve(size_t(columns) * rows);
    mesh.uvs.reserve(size_t(columns) * rows);
    for (uint32_t j = 0; j < rows; ++j)
        for (uint32_t i = 0; i < columns; ++i) {
            const double u = double(i) / (columns - 1), t = double(j) / (rows - 1);
            mesh.positions.emplace_back(float((u - 0.5) * size.x()), 0.0f, float((t - 0.5) * size.y()));
            mesh.uvs.emplace_back(float(u), float(1.0 - t));
        }
    return mesh;
}

// Two triangles for each square of the grid, cut along the shorter diagonal, which preserves ridges and
// valleys.
void append_squares(Mesh& mesh, uint32_t columns, uint32_t rows) {
    mesh.triangles.reserve(2 * size_t(columns - 1) * (rows - 1));
    for (uint32_t j = 0; j + 1 < rows; ++j)
        for (uint32_t i = 0; i + 1 < columns; ++i) {
            const uint32_t a = j * columns + i, b = a + 1, c = a + columns, d = c + 1;
            const auto length = [&](uint32_t p, uint32_t q) {
                return (mesh.positions[p] - mesh.positions[q]).norm();
            };
            if (length(b, c) <= length(a, d)) {
                mesh.triangles.push_back({a, c, b});
                mesh.triangles.push_back({b, c, d});
            } else {
                mesh.triangles.push_back({a, c, d});
                mesh.triangles.push_back({a, d, b});
            }
        }
}

// ---- Sphere

// f(d) = mean over the axes i of sin(frequency d_i + phase_i): smooth on the whole sphere, |f| <= 1. The
// phases break the symmetry.
struct Bumps {
    double radius, amplitude, frequency;
    static constexpr double phase[3] = {0.3, 1.7, 2.9};

    double radius_at(const Vec3d& d) const {
        double sum = 0.0;
        for (int i = 0; i < 3; ++i) sum += std::sin(frequency * d[i] + phase[i]);
        return radius + amplitude * sum / 3.0;
    }
    // The surface is |p| = r(p / |p|); its gradient at p = r d is
    //   d - (grad f - (d . grad f) d) amplitude / r.
    Vec3d normal_at(const Vec3d& d) const {
        Vec3d gradient;
        for (int i = 0; i < 3; ++i) gradient[i] = std::cos(frequency * d[i] + phase[i]) * frequency / 3.0;
        const Vec3d along = gradient - d.dot(gradient) * d;
        return (d - along * (amplitude / radius_at(d))).normalized();
    }
};

// Rows of latitude 0 (north pole) ... 2 n (south pole). Row k has 4 min(k, 2 n - k) edges, and one more
// vertex for the seam. A pole is a row of 4 vertices, one for each triangle that ends there.
uint32_t edges_in_row(uint32_t row, uint32_t n) { return 4 * std::min(row, 2 * n - row); }

void append_row(Mesh& mesh, const Bumps& bumps, uint32_t row, uint32_t n) {
    const uint32_t edges = edges_in_row(row, n);
    const bool pole = edges == 0;
    const double theta = pi * row / (2.0 * n); // from the north pole
    const double ring = pole ? 0.0 : std::sin(theta), height = row == n ? 0.0 : std::cos(theta);
    for (uint32_t i = 0; i < (pole ? 4 : edges + 1); ++i) {
        const double phi =
            pole ? 0.0 : 2.0 * pi * (i % edges) / edges; // both ends of the seam get the same bits
        const Vec3d d(ring * std::cos(phi), height, -ring * std::sin(phi));
        mesh.positions.push_back((bumps.radius_at(d) * d).cast<float>());
        mesh.normals.push_back(bumps.normal_at(d).cast<float>());
        mesh.uvs.emplace_back(float(pole ? (i + 0.5) / 4.0 : double(i) / edges),
                              float(1.0 - row / (2.0 * n)));
    }
}

// Triangles between a row and the next one farther from its pole. In each quarter, k + 1 have an edge on the
// longer row and k on the shorter. flip: the longer row is the northern one.
void append_band(Mesh& mesh, uint32_t inner, uint32_t outer, uint32_t k, bool flip) {
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
        mesh.triangles.push_back(flip ? Triangle{a, c, b} : Triangle{a, b, c});
    };
    for (uint32_t quarter = 0; quarter < 4; ++quarter) {
        const uint32_t in = inner + (k == 0 ? quarter : quarter * k), out = outer + quarter * (k + 1);
        for (uint32_t i = 0; i <= k; ++i) add(in + i, out + i, out + i + 1);
        for (uint32_t i = 0; i < k; ++i) add(in + i, out + i + 1, in + i + 1);
    }
}

} // namespace

Mesh plane_mesh(Vec2f size, int divisions) {
    check_size("plane", "size", size.x());
    check_size("plane", "size", size.y());
    check_divisions("plane", divisions, 2 * uint64_t(divisions) * uint64_t(divisions));
    const uint32_t side = uint32_t(divisions) + 1;
    Mesh mesh = grid(size, side, side);
    mesh.normals.assign(mesh.positions.size(), Vec3f::UnitY());
    append_squares(mesh, side, side);
    finish(mesh);
    return mesh;
}

Mesh box_mesh(Vec3f size) {
    for (int axis = 0; axis < 3; ++axis) check_size("box", "size", size[axis]);
    Mesh mesh;
    for (int axis = 0; axis < 3; ++axis)
        for (float side : {-0.5f, 0.5f}) {
            const Vec3f outward = Vec3f::Unit(axis) * side;
            // u, v and the outward direction are right-handed; v points up on vertical sides.
            const Vec3f v = axis == 1 ? Vec3f(0.0f, 0.0f, -2.0f * side) : Vec3f(0.0f, 1.0f, 0.0f);
            const Vec3f u = v.cross(2.0f * outward);
            const uint32_t first = uint32_t(mesh.positions.size());
            for (int corner = 0; corner < 4; ++corner) {
                const float s = float(corner & 1), t = float(corner >> 1);
                mesh.positions.push_back((outward + (s - 0.5f) * u + (t - 0.5f) * v).cwiseProduct(size));
                mesh.uvs.emplace_back(s, t);
            }
            mesh.triangles.push_back({first, first + 1, first + 2});
            mesh.triangles.push_back({first + 2, first + 1, first + 3});
        }
    finish(mesh);
    return mesh;
}

Mesh sphere_mesh(float radius, int divisions, float bump_amplitude, float bump_frequency) {
    check_size("sphere", "radius", radius);
    check_divisions("sphere", divisions, 8 * uint64_t(divisions) * uint64_t(divisions));
    if (!(std::fabs(bump_amplitude) < radius))
        refuse("sphere", fmt::format("bumps of {} on a radius of {}", bump_amplitude, radius),
               "give an amplitude below the radius");
    if (!std::isfinite(bump_frequency))
        refuse("sphere", "the bumps' frequency is not finite", "give a finite one");
    const Bumps bumps{radius, bump_amplitude, bump_frequency};
    const uint32_t n = uint32_t(divisions);
    Mesh mesh;
    std::vector<uint32_t> first; // vertex of each row
    for (uint32_t row = 0; row <= 2 * n; ++row) {
        first.push_back(uint32_t(mesh.positions.size()));
        append_row(mesh, bumps, row, n);
    }
    mesh.triangles.reserve(8 * size_t(n) * n);
    for (uint32_t k = 0; k < n; ++k) append_band(mesh, first[k], first[k + 1], k, false);
    for (uint32_t k = n; k-- > 0;) append_band(mesh, first[2 * n - k], first[2 * n - k - 1], k, true);
    finish(mesh);
    return mesh;
}

Mesh heightfield_mesh(std::span<const float> heights, int width, int height, Vec2f size, float height_scale) {
    check_size("heightfield", "size", size.x());
    check_size("heightfield", "size", size.y());
    if (width < 2 || height < 2 || heights.size() != size_t(width) * size_t(height))
        refuse("heightfield", fmt::format("{} heights for {} x {} samples", heights.size(), width, height),
               "give at least 2 x 2 samples");
    if (heights.size() > max_count / 2)
        refuse("heightfield", "has too many samples", "make the image smaller");
    Mesh mesh = grid(size, uint32_t(width), uint32_t(height));
    for (size_t i = 0; i < heights.size(); ++i) {
        const double y = double(heights[i]) * height_scale;
        if (!(std::fabs(y) <= embree_limit))
            refuse(
                "heightfield",
                fmt::format("the height of sample ({}, {}) is {}", i % size_t(width), i / size_t(width), y),
                "give finite heights");
        mesh.positions[i].y() = float(y);
    }
    append_squares(mesh, uint32_t(width), uint32_t(height));
    mesh.normals = vertex_normals(mesh.positions, mesh.triangles);
    finish(mesh);
    return mesh;
}

} // namespace marram
