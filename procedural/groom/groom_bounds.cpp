// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/groom_bounds.h"

#include <limits>

namespace marram {
namespace {

// How far anything of a strand, its width and its clearance included, may be from its root. `scale`: the greatest coordinate.
// Whatever bends a strand keeps its length, so it stays in a ball about its root. B-splines stay within the hull of their
// CVs (drawn to the tip with the phantom rule too); Catmull-Rom leaves it by less than a third of a segment.
double reach_from_root(const GroomInstance& instance, double scale) {
    const Groom& groom = instance.groom;
    const double length = longest_strand(groom);
    double widest = 0.0;
    for (const float half : instance.width_profile) widest = std::max(widest, double(half));
    const double beyond = groom.basis == MARRAM_CATMULL_ROM ? length / (3.0 * (groom.cvs - 1)) : 0.0;
    double lift = 0.0, clearance = 0.0;
    if (const auto& collision = instance.wind.collision) {
        lift = root_offset(*collision, length, groom.width * instance.width_profile[0]);
        clearance = std::max(collision->clearance.value_or(0.0), lift);
    }
    return (length + beyond + groom.width * widest + lift + clearance) * (1.0 + 1e-5) +
           4.0 * (scale + length + lift) * 0x1p-23;
}

} // namespace

Eigen::AlignedBox3d bounds_of_strands(const GroomInstance& instance) {
    Eigen::AlignedBox3d box;
    const MarramMesh& mesh = *instance.mesh;
    for (uint32_t time = 0; time < mesh.time_count; ++time)
        for (size_t v = 0; v < mesh.vertex_count; ++v)
            box.extend(Eigen::Map<const Vec3f>(mesh.positions[time] + 3 * v).cast<double>());
    const double reach =
        reach_from_root(instance, std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff()));
    return {box.min().array() - reach, box.max().array() + reach};
}

Eigen::AlignedBox3d bounds_at_rest(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    Eigen::AlignedBox3d box;
    for (uint32_t time = 0; time < mesh.time_count; ++time)
        extend_by_rest(instance.groom, std::span(mesh.positions[time], 3 * size_t(mesh.vertex_count)), box);
    for (const PastSkin::Pose& pose : instance.past.poses)
        extend_by_rest(instance.groom, pose.positions, box);
    return box;
}

void find_patch(const GroomInstance& instance, uint32_t index, MarramPatch* out) {
    const std::span<const Root> roots = instance.patch_roots(index);
    out->first_curve = uint64_t(roots.data() - instance.roots.data());
    out->curve_count = uint32_t(roots.size());
    Vec3d lower = Vec3d::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
    const uint32_t poses = std::min(instance.time_count, instance.mesh->time_count);
    for (uint32_t time = 0; time < poses; ++time) {
        const Surface now = instance.poses(time).now;
        for (const Root root : roots) {
            const Vec3d p = now.point(root.triangle, root_weights(instance.groom.seed, root));
            lower = lower.cwiseMin(p);
            upper = upper.cwiseMax(p);
        }
    }
    const double reach =
        reach_from_root(instance, std::max(lower.cwiseAbs().maxCoeff(), upper.cwiseAbs().maxCoeff()));
    for (int axis = 0; axis < 3; ++axis) {
        out->lower[axis] = float(lower[axis] - reach);
        out->upper[axis] = float(upper[axis] + reach);
    }
}

} // namespace marram
