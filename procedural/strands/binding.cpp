// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/binding.h"

#include "procedural/abi/parallel.h"
#include "procedural/wind/collision/skin.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace marram {
namespace {

constexpr double far_share = 0.1; // of a strand's length

// Barycentric coordinates of a point of a triangle that has an area.
Vec3d weights_of(const std::array<Vec3d, 3>& p, const Vec3d& q) {
    const Vec3d n = (p[1] - p[0]).cross(p[2] - p[0]);
    const double area = n.squaredNorm();
    Vec3d weights(0.0, (q - p[0]).cross(p[2] - p[0]).dot(n) / area,
                  (p[1] - p[0]).cross(q - p[0]).dot(n) / area);
    weights[1] = std::clamp(weights[1], 0.0, 1.0);
    weights[2] = std::clamp(weights[2], 0.0, 1.0 - weights[1]);
    weights[0] = 1.0 - weights[1] - weights[2];
    return weights;
}

// A frame with the surface as its only collider, for closest point queries.
struct ClosestPointQuery {
    const float* positions[1];
    MarramMesh mesh{};
    MarramFrame frame{};
    Colliders colliders;
    Eigen::AlignedBox3d box;

    ClosestPointQuery(const Surface& surface, uint32_t vertex_count) : positions{surface.positions} {
        mesh.name = "";
        mesh.roles = MARRAM_COLLIDES;
        mesh.vertex_count = vertex_count;
        mesh.triangle_count = surface.triangle_count;
        mesh.time_count = 1;
        mesh.positions = positions;
        mesh.triangles = surface.triangles;
        frame.time_count = 1;
        frame.meshes = &mesh;
        frame.mesh_count = 1;
        frame.mesh_stride = sizeof(MarramMesh);
        colliders.lent = &mesh;
        colliders.meshes = {&mesh};
        colliders.tree = std::make_shared<const ColliderTree>(frame, everywhere(), 0);
        for (uint32_t t = 0; t < surface.triangle_count; ++t)
            for (const Vec3d& p : surface.corners(t)) box.extend(p);
    }
    ClosestPointQuery(const ClosestPointQuery&) = delete;
    ClosestPointQuery& operator=(const ClosestPointQuery&) = delete;
};

} // namespace

double curve_length(const float* vertices, uint32_t cvs) {
    double length = 0.0;
    for (uint32_t k = 0; k + 1 < cvs; ++k)
        length += (cv_at(vertices + 4 * (k + 1)) - cv_at(vertices + 4 * k)).norm();
    return length;
}

Binding bind_strands(const LentCurves& curves, const float* vertices, const Surface& bind,
                     uint32_t vertex_count, const std::function<bool()>& cancelled) {
    Binding binding;
    binding.root_bindings.resize(curves.count());
    const ClosestPointQuery query(bind, vertex_count);
    // Roots and skin are floats, usually transformed independently by two programs: allow for eight roundings
    // of half an ulp.
    binding.rounding =
        0x1p-21 * std::max(query.box.min().cwiseAbs().maxCoeff(), query.box.max().cwiseAbs().maxCoeff());
    std::atomic<uint64_t> reversed{0};
    marram::parallel_for(tbb::blocked_range<uint64_t>(0, curves.count(), 256), [&](const auto& range) {
        if (cancelled()) return;
        uint32_t hint = no_triangle; // triangle of the previous strand, which is usually close
        uint32_t tip_hint = no_triangle;
        const auto foot_of = [&](const Vec3d& point, uint32_t& near) {
            // No triangle is farther away than this.
            const double reach =
                (query.box.exteriorDistance(point) + query.box.diagonal().norm()) * (1.0 + 1e-9);
            SkinPoint foot{};
            closest_skin_point(query.colliders, query.mesh, point, /*facing: any*/ Vec3d::Zero(), reach, near,
                               foot);
            near = foot.triangle;
            return foot;
        };
        for (uint64_t c = range.begin(); c < range.end(); ++c) {
            const float* cvs = vertices + 4 * (curves.first_vertex(c) + 1);
            const Vec3d root = cv_at(cvs);
            const SkinPoint foot = foot_of(root, hint);
            binding.root_bindings[c] = {weights_of(bind.corners(foot.triangle), foot.point), foot.triangle,
                                        float((root - foot.point).norm()),
                                        float(root_height(root, foot.point, foot.normal, binding.rounding))};
            const double near = far_share * curve_length(cvs, curves.cvs(c)) + binding.rounding;
            if ((root - foot.point).norm() <= near) continue;
            const Vec3d tip = cv_at(cvs + 4 * (curves.cvs(c) - 1));
            if ((tip - foot_of(tip, tip_hint).point).norm() <= near) ++reversed;
        }
    });
    if (cancelled()) return binding;
    binding.reversed = reversed;
    for (uint64_t c = 0; c < curves.count(); ++c) {
        const double height = double(binding.root_bindings[c].height),
                     distance = double(binding.root_bindings[c].distance);
        const double length = curve_length(vertices + 4 * (curves.first_vertex(c) + 1), curves.cvs(c));
        binding.greatest_distance = std::max(binding.greatest_distance, distance);
        binding.mean_distance += distance / double(curves.count());
        if (!(length > 0.0)) ++binding.no_length;
        if (distance > far_share * length + binding.rounding) ++binding.far;
        if (height < 0.0) {
            ++binding.inside;
            binding.deepest = std::max(binding.deepest, -height);
        }
    }
    return binding;
}

RootProblem root_problem(const Binding& binding, const std::string& kind, const std::string& mesh) {
    if (binding.far == 0) return {};
    const size_t all = binding.root_bindings.size();
    if (2 * binding.reversed > binding.far)
        return {
            "reversed",
            fmt::format(
                "{} of {} {} end on '{}' and begin up to {:.3g} m away from it: they run from tip to root",
                binding.reversed, all, kind, mesh, binding.greatest_distance),
            "give their curves reverse = true"};
    return {"far",
            fmt::format("{} of {} {} begin farther from '{}' than a tenth of their length, up to {:.3g} m",
                        binding.far, all, kind, mesh, binding.greatest_distance),
            "check the units and transforms of both, and bind_frame"};
}

} // namespace marram
