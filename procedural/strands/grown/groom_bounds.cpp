// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/groom_bounds.h"

#include <algorithm>
#include <limits>
#include <span>

namespace marram {
namespace {

// Greatest distance of any part of a strand from its root, including width and clearance. `max_coordinate`:
// of the roots; `width_factor`: the greatest, of rendered widths. Bending preserves length, so a strand stays
// in a ball about its root. B-splines stay in the convex hull of their CVs, also in the end spans with phantom
// CVs; Catmull-Rom leaves it by less than a third of a segment.
double reach_from_root(const GroomInstance& instance, double max_coordinate, double width_factor) {
    const Groom& groom = instance.groom;
    const double length = longest_strand(groom);
    double max_radius = 0.0; // of a strand of width 1
    for (const float radius : instance.radius_profile) max_radius = std::max(max_radius, double(radius));
    const double overshoot = groom.basis == MARRAM_CATMULL_ROM ? length / (3.0 * (groom.cvs - 1)) : 0.0;
    double offset = 0.0, clearance = 0.0;
    if (const auto& collision = instance.wind.collision) {
        offset = root_offset(*collision, length, groom.width * instance.radius_profile[0]);
        clearance = std::max(collision->clearance.value_or(0.0), offset);
    }
    // At least 1: clearances do not shrink with instances.
    const double instance_scale = std::max(max_instance_scale(instance.mesh_instances), 1.0);
    return instance_scale *
               (length + overshoot + width_factor * groom.width * max_radius + offset + clearance) *
               (1.0 + 1e-5) +
           4.0 * (max_coordinate + instance_scale * (length + offset)) * 0x1p-23;
}

// Extends `box` by the mesh's box at each of its instances, at a motion sample.
void extend_by_instances(const GroomInstance& instance, uint32_t time, const Eigen::AlignedBox3d& on_mesh,
                         Eigen::AlignedBox3d& box) {
    for (const MeshInstance& mesh_instance : instance.mesh_instances)
        box.extend(mesh_instance.is_instance ? transformed_box(mesh_instance.transform(time), on_mesh)
                                             : on_mesh);
}

uint32_t time_count_of(const GroomInstance& instance) {
    return std::any_of(instance.mesh_instances.begin(), instance.mesh_instances.end(),
                       [](const MeshInstance& mesh_instance) { return mesh_instance.moves(); })
               ? std::max(instance.time_count, instance.mesh->time_count)
               : instance.mesh->time_count;
}

} // namespace

Eigen::AlignedBox3d bounds_of_strands(const GroomInstance& instance) {
    Eigen::AlignedBox3d box;
    const MarramMesh& mesh = *instance.mesh;
    for (uint32_t time = 0; time < time_count_of(instance); ++time) {
        Eigen::AlignedBox3d on_mesh;
        const float* positions = mesh.positions[std::min(time, mesh.time_count - 1)];
        for (size_t v = 0; v < mesh.vertex_count; ++v)
            on_mesh.extend(Eigen::Map<const Vec3f>(positions + 3 * v).cast<double>());
        extend_by_instances(instance, time, on_mesh, box);
    }
    const double reach =
        reach_from_root(instance, std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff()),
                        instance.made.widest);
    return {box.min().array() - reach, box.max().array() + reach};
}

Eigen::AlignedBox3d bounds_at_rest(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    Eigen::AlignedBox3d box;
    for (uint32_t time = 0; time < time_count_of(instance); ++time) {
        Eigen::AlignedBox3d on_mesh;
        const float* positions = mesh.positions[std::min(time, mesh.time_count - 1)];
        extend_by_rest(instance.groom, std::span(positions, 3 * size_t(mesh.vertex_count)), on_mesh);
        extend_by_instances(instance, time, on_mesh, box);
    }
    std::vector<Eigen::AlignedBox3d> past;
    for (const auto& pose : instance.past.poses)
        extend_by_rest(instance.groom, pose->positions, past.emplace_back());
    for (const Eigen::AlignedBox3d& on_mesh : past) box.extend(on_mesh);
    for (const MeshInstance& mesh_instance : instance.mesh_instances)
        for (size_t k = 0;
             k < mesh_instance.past_transforms.size() && k < instance.past.pose_of_sample.size(); ++k)
            box.extend(
                transformed_box(mesh_instance.past_transforms[k], past[instance.past.pose_of_sample[k]]));
    return box;
}

MarramPatch patch_bounds(const GroomInstance& instance, uint32_t index) {
    MarramPatch out{};
    const GroomPatch patch = instance.patch_at(index);
    out.first_curve = patch.first_curve;
    out.curve_count = uint32_t(patch.roots.size());
    Vec3d lower = Vec3d::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
    double max_coordinate = 0.0;
    const double scale = max_instance_scale(std::span(&patch.mesh_instance, 1));
    const uint32_t poses = std::min(
        instance.time_count, patch.mesh_instance.moves() ? instance.time_count : instance.mesh->time_count);
    for (uint32_t time = 0; time < poses; ++time) {
        const Surface now = instance.poses(time).now;
        for (const Root root : patch.roots) {
            Vec3d p = now.point(root.triangle, root_weights(instance.groom.seed, root));
            if (patch.mesh_instance.is_instance) { // strands are rounded on the mesh, too
                max_coordinate = std::max(max_coordinate, scale * p.cwiseAbs().maxCoeff());
                p = patch.mesh_instance.transform(time) * p;
            }
            lower = lower.cwiseMin(p);
            upper = upper.cwiseMax(p);
        }
    }
    max_coordinate = std::max({max_coordinate, lower.cwiseAbs().maxCoeff(), upper.cwiseAbs().maxCoeff()});
    const double widest =
        patch.width_factors.empty() ? 1.0 : double(*std::ranges::max_element(patch.width_factors));
    const double reach = reach_from_root(instance, max_coordinate, widest);
    for (int axis = 0; axis < 3; ++axis) {
        out.lower[axis] = float(lower[axis] - reach);
        out.upper[axis] = float(upper[axis] + reach);
    }
    return out;
}

} // namespace marram
