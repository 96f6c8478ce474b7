// SPDX-License-Identifier: Apache-2.0
#include "procedural/air/height_grid.h"

#include "core/math/vec.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace marram {
namespace {

constexpr float no_height = -std::numeric_limits<float>::infinity();
constexpr size_t max_fine_samples = size_t(1) << 24, max_samples = size_t(1) << 20;

struct Plan { // of a mesh
    Vec2d lower = Vec2d::Constant(infinity), upper = Vec2d::Constant(-infinity);
    double area = 0.0, whole = 0.0; // of all triangles, seen from above, and their own
};

std::array<Vec3d, 3> mesh_corners(const MarramMesh& mesh, size_t triangle) {
    std::array<Vec3d, 3> p;
    for (size_t k = 0; k < 3; ++k) {
        const float* const v = mesh.positions[0] + 3 * size_t(mesh.triangles[3 * triangle + k]);
        p[k] = Vec3d(double(v[0]), double(v[1]), double(v[2]));
    }
    return p;
}

double twice_plan_area(const std::array<Vec3d, 3>& p) {
    return (p[1].x() - p[0].x()) * (p[2].z() - p[0].z()) - (p[1].z() - p[0].z()) * (p[2].x() - p[0].x());
}

Plan plan_of(const MarramMesh& mesh) {
    Plan plan;
    for (size_t f = 0; f < mesh.triangle_count; ++f) {
        const std::array<Vec3d, 3> p = mesh_corners(mesh, f);
        for (const Vec3d& q : p) {
            if (!q.allFinite()) return {};
            plan.lower = plan.lower.cwiseMin(Vec2d(q.x(), q.z()));
            plan.upper = plan.upper.cwiseMax(Vec2d(q.x(), q.z()));
        }
        plan.area += 0.5 * std::abs(twice_plan_area(p));
        plan.whole += 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
    }
    return plan;
}

// Raises the samples below a triangle to it.
void raise(const std::array<Vec3d, 3>& p, HeightGrid& grid) {
    constexpr double slack = 1e-4; // of the triangle: vertices are floats, and samples may lie on them
    const double area = twice_plan_area(p);
    if (area == 0.0) return;
    const auto range = [&](int axis, double origin, int count) {
        const auto [low, high] = std::minmax({p[0][axis], p[1][axis], p[2][axis]});
        const double first = std::ceil((low - origin) / grid.cell - slack);
        const double last = std::floor((high - origin) / grid.cell + slack);
        return std::pair(int(std::clamp(first, 0.0, double(count))),
                         int(std::clamp(last + 1.0, 0.0, double(count))));
    };
    const auto [i0, i1] = range(0, grid.x0, grid.nx);
    const auto [j0, j1] = range(2, grid.z0, grid.nz);
    for (int j = j0; j < j1; ++j)
        for (int i = i0; i < i1; ++i) {
            const Vec3d at(grid.x0 + i * grid.cell, 0.0, grid.z0 + j * grid.cell);
            const double b = twice_plan_area({p[0], at, p[2]}) / area;
            const double c = twice_plan_area({p[0], p[1], at}) / area;
            if (std::min({b, c, 1.0 - b - c}) < -slack) continue;
            const double y = p[0].y() + b * (p[1].y() - p[0].y()) + c * (p[2].y() - p[0].y());
            float& height = grid.heights[grid.index(i, j)];
            height = std::max(height, float(y));
        }
}

// Means of factor x factor samples: the samples without a height do not count.
HeightGrid averaged(const HeightGrid& fine, int factor) {
    HeightGrid grid;
    grid.nx = (fine.nx + factor - 1) / factor, grid.nz = (fine.nz + factor - 1) / factor;
    grid.cell = fine.cell * factor;
    grid.x0 = fine.x0 + 0.5 * (factor - 1) * fine.cell, grid.z0 = fine.z0 + 0.5 * (factor - 1) * fine.cell;
    grid.heights.resize(size_t(grid.nx) * size_t(grid.nz));
    for (int j = 0; j < grid.nz; ++j)
        for (int i = 0; i < grid.nx; ++i) {
            double sum = 0.0;
            int count = 0;
            for (int b = j * factor; b < std::min((j + 1) * factor, fine.nz); ++b)
                for (int a = i * factor; a < std::min((i + 1) * factor, fine.nx); ++a)
                    if (const float h = fine.heights[fine.index(a, b)]; h != no_height)
                        sum += double(h), ++count;
            grid.heights[grid.index(i, j)] = count > 0 ? float(sum / count) : no_height;
        }
    return grid;
}

// Gives samples without a height that of a grid of half as many, which is filled likewise: push and pull.
void fill_holes(HeightGrid& grid) {
    if (std::ranges::find(grid.heights, no_height) == grid.heights.end()) return;
    HeightGrid half = averaged(grid, 2);
    if (half.heights.size() > 1) fill_holes(half);
    for (int j = 0; j < grid.nz; ++j)
        for (int i = 0; i < grid.nx; ++i) {
            float& height = grid.heights[grid.index(i, j)];
            if (height != no_height) continue;
            const double x = std::clamp(0.5 * i - 0.25, 0.0, double(half.nx - 1));
            const double z = std::clamp(0.5 * j - 0.25, 0.0, double(half.nz - 1));
            const int a = std::min(int(x), std::max(half.nx - 2, 0)),
                      b = std::min(int(z), std::max(half.nz - 2, 0));
            const auto row = [&](int at) {
                const double first = double(half.heights[half.index(a, at)]);
                const double second = double(half.heights[half.index(std::min(a + 1, half.nx - 1), at)]);
                return first + (x - a) * (second - first);
            };
            const double low = row(b), high = row(std::min(b + 1, half.nz - 1));
            height = float(low + (z - b) * (high - low));
        }
}

} // namespace

HeightGrid coarsened(HeightGrid grid) {
    int factor = 1;
    while (grid.heights.size() / size_t(factor) / size_t(factor) > max_samples) ++factor;
    return factor > 1 ? averaged(grid, factor) : std::move(grid);
}

HeightGrid heights_from_above(const MarramMesh& mesh) {
    const Plan plan = plan_of(mesh);
    constexpr double upright = 1e-6; // of a wall whose corners are rounded to floats
    if (!(plan.area > upright * plan.whole)) return {};
    const Vec2d extent = plan.upper - plan.lower;
    constexpr double min_cells = 255.0;
    HeightGrid grid;
    grid.cell = std::min(std::sqrt(2.0 * plan.area / mesh.triangle_count), extent.maxCoeff() / min_cells);
    const double most = double(max_fine_samples);
    grid.cell =
        std::max({grid.cell, std::sqrt(extent.x() * extent.y() / most), extent.maxCoeff() / (most / 16.0)});
    grid.x0 = plan.lower.x(), grid.z0 = plan.lower.y();
    constexpr double rounding = 1e-3; // of a cell
    grid.nx = int(std::ceil(extent.x() / grid.cell - rounding)) + 1;
    grid.nz = int(std::ceil(extent.y() / grid.cell - rounding)) + 1;
    grid.heights.assign(size_t(grid.nx) * size_t(grid.nz), no_height);
    for (size_t f = 0; f < mesh.triangle_count; ++f) raise(mesh_corners(mesh, f), grid);
    grid = coarsened(std::move(grid));
    fill_holes(grid);
    return grid;
}

} // namespace marram
