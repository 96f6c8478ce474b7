// SPDX-License-Identifier: Apache-2.0
#include "core/measure/errors.h"

#include "core/shot/settings.h"
#include "core/trace/hit.h"
#include "core/world/curve_compare.h"
#include "core/world/mesh_compare.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram {
namespace {

// Bilinear interpolation in a grid with one component; clamped beyond its border.
double grid_at(const GridValues& values, double x, double z) {
    const MarramGrid& grid = values.grid;
    const auto place = [](double at, double origin, double step, uint32_t count) {
        return std::clamp((at - origin) / step, 0.0, double(count - 1));
    };
    const double u = place(x, grid.origin[0], grid.axes[0][0], grid.nx),
                 v = place(z, grid.origin[2], grid.axes[1][2], grid.ny);
    const auto i = uint32_t(u), j = uint32_t(v);
    const uint32_t i1 = std::min(i + 1, grid.nx - 1), j1 = std::min(j + 1, grid.ny - 1);
    const auto at = [&](uint32_t a, uint32_t b) { return double(values.values[size_t(b) * grid.nx + a]); };
    const double s = u - i, t = v - j;
    return (1 - t) * ((1 - s) * at(i, j) + s * at(i1, j)) + t * ((1 - s) * at(i, j1) + s * at(i1, j1));
}

void compare_heights(const GridValues& mine, const GridValues& exact, MeshDistance& sum) {
    const MarramGrid& grid = exact.grid;
    for (uint32_t j = 0; j < grid.ny; ++j)
        for (uint32_t i = 0; i < grid.nx; ++i)
            sum.add(std::abs(
                grid_at(mine, grid.origin[0] + i * grid.axes[0][0], grid.origin[2] + j * grid.axes[1][2]) -
                double(exact.values[size_t(j) * grid.nx + i])));
}

// The height of a mesh below a point; NaN if a ray down from the point misses it.
double height_below(const World& world, uint32_t mesh, const Vec3f& from) {
    Ray ray{from, -Vec3f::UnitY()};
    SurfacePoint point;
    while (intersect(world, ray, point, false)) {
        if (point.geometry == mesh) return point.position.y();
        // Another mesh is above it: continue from there, past the rounding error of the distance.
        const float distance = std::max(from.y() - float(point.position.y()), ray.tnear);
        ray.tnear = distance * (1.0F + 0x1p-20F);
    }
    return std::numeric_limits<double>::quiet_NaN();
}

} // namespace

double pixel_size(const Shot& shot, double frame) {
    const BuildSettings settings = build_settings(shot, frame);
    return settings.view.pixel_angle *
           (shot.description.camera.vec3("target") - settings.view.position).norm();
}

void compare_surfaces(const World& world, const World& reference, SettingResult& result) {
    MeshDistance sum;
    for (uint32_t id = 0; id < std::min(world.meshes.size(), reference.meshes.size()); ++id) {
        const MeshGeometry &mine = world.growth_surface(id), &exact = reference.growth_surface(id);
        const bool heights = !mine.grids.empty() && !exact.grids.empty() && exact.grids[0].name == "height";
        if (heights)
            compare_heights(mine.grids[0], exact.grids[0], sum);
        else if (mine.topology != exact.topology)
            sum.add(mesh_distance(world, id, exact));
    }
    result.error = sum.rms();
    result.worst = sum.worst;
}

void compare_attributes(const World& world, const World& reference, SettingResult& result) {
    double squares = 0.0, size = 0.0, worst = 0.0, count = 0.0;
    for (uint32_t id = 0; id < std::min(world.meshes.size(), reference.meshes.size()); ++id) {
        const auto &mine = world.growth_surface(id).attributes,
                   &exact = reference.growth_surface(id).attributes;
        if (mine.empty() || exact.empty() || exact[0].discrete) continue;
        if (mine[0].values.size() != exact[0].values.size()) {
            result.refused = "not measured: the reference has other vertices";
            return;
        }
        for (size_t k = 0; k < exact[0].values.size(); ++k) {
            const double gap = double(mine[0].values[k]) - double(exact[0].values[k]);
            squares += gap * gap, worst = std::max(worst, std::abs(gap));
            size += double(exact[0].values[k]) * double(exact[0].values[k]);
            count += 1.0;
        }
    }
    const double scale = count > 0.0 ? std::sqrt(size / count) : 0.0;
    if (!(scale > 0.0)) result.refused = "not measured: there is nothing to compare";
    result.error = scale > 0.0 ? std::sqrt(squares / count) / scale : 0.0;
    result.worst = scale > 0.0 ? worst / scale : 0.0;
}

void compare_views(const Shot& shot, double frame, const World& world, const World& reference,
                   SettingResult& result) {
    const View view = build_settings(shot, frame).view;
    double squares = 0.0, count = 0.0;
    for (const auto& [id, growth] : reference.growth_surfaces) {
        const MeshGeometry& exact = reference.meshes[id];
        const float above = std::max(reference.bounds.max().y(), world.bounds.max().y()) + 1.0F;
        constexpr size_t enough = 100000; // vertices, at regular intervals
        const size_t step = std::max(exact.positions[0].size() / enough, size_t(1));
        for (size_t v = 0; v < exact.positions[0].size(); v += step) {
            const Vec3f& vertex = exact.positions[0][v];
            const Vec3d way = vertex.cast<double>() - view.position;
            if (way.dot(view.forward) < view.cosine * way.norm()) continue; // outside the view cone
            const double height = height_below(world, id, {vertex.x(), above, vertex.z()});
            if (std::isnan(height)) continue; // at the border of the mesh
            const double gap = std::abs(height - double(vertex.y())) / (view.pixel_angle * way.norm());
            squares += gap * gap;
            count += 1.0;
            result.worst = std::max(result.worst, gap);
        }
    }
    result.error = count > 0.0 ? std::sqrt(squares / count) : 0.0;
}

void compare_strands(const Dial& dial, const Shot& shot, double frame, const World& world,
                     const World& reference, SettingResult& result) {
    const bool motion = dial.error == DialError::motion;
    const CurveDistance gap = motion ? motion_cv_distance(world, reference, build_settings(shot, frame).view)
                                     : relative_cv_distance(world, reference);
    const double unit = motion ? pixel_size(shot, frame) : 1.0;
    result.error = motion ? gap.most / unit : gap.rms;
    result.worst = gap.worst / unit;
    if (!motion) result.most = cv_distance(world, reference).most;
    if (dial.counts_crossing) result.crossing = count_crossing_strands(world);
}

void compare_after_contact(const World& world, const World& reference, double tolerance,
                           SettingResult& result) {
    result.beyond = cv_distance(world, reference, tolerance).beyond;
}

} // namespace marram
