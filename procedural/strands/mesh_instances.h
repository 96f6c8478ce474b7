// SPDX-License-Identifier: Apache-2.0
// The meshes on which a groom grows, or to which imported strands are bound: one mesh and each of its
// instances. Roots, guides, bindings and the settings chosen by the tolerance are computed once. A strand of
// an instance is laid out on the mesh and transformed to the instance; from then on it is an independent
// strand in the wind at its own position. Lengths, widths and heights above the skin scale with the instance.
#pragma once

#include "procedural/wind/jiggle.h"
#include "procedural/wind/strands.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <span>
#include <vector>

namespace marram {

struct MeshInstance {
    const MarramMesh* mesh = nullptr;
    bool is_instance = false; // if not: the mesh itself
    // Map world positions on the groom's mesh to world positions on this instance. The identity for the mesh
    // itself.
    Eigen::Affine3d transform_at_bind = Eigen::Affine3d::Identity();
    std::vector<Eigen::Affine3d> transforms = {Eigen::Affine3d::Identity()}; // [motion sample], or one
    std::vector<Eigen::Affine3d> past_transforms; // [past sample of the jiggle's window]

    const Eigen::Affine3d& transform(uint32_t time) const {
        return transforms[std::min<size_t>(time, transforms.size() - 1)];
    }
    bool moves() const { return transforms.size() > 1; }
    bool moved() const { // it is elsewhere at a past sample than at the first motion sample
        return std::ranges::any_of(past_transforms, [&](const Eigen::Affine3d& transform) {
            return transform.matrix() != transforms[0].matrix();
        });
    }
    // past_sample: index into past_transforms; 0 is the first sample of the jiggle's window.
    const Eigen::Affine3d& past_transform(size_t past_sample) const {
        return is_instance ? past_transforms[past_sample] : transforms[0];
    }
};

// The uniform scale of a transform, and the greatest one of all mesh instances. Transforms are similarities,
// as checked by place_lent_instance().
double uniform_scale(const Eigen::Affine3d& transform);
double max_instance_scale(std::span<const MeshInstance> mesh_instances);

// The bounds of the transformed box.
Eigen::AlignedBox3d transformed_box(const Eigen::Affine3d& transform, const Eigen::AlignedBox3d& box);

// Finds the groom's mesh (mesh_instances[0]) and its instances among the frame's meshes. Throws SceneFault if
// the host cannot place an instance.
std::vector<MeshInstance> find_mesh_instances(const MarramFrame& frame, const MarramMesh& mesh);

// The largest displacement in m of an instance between the first motion sample and 1, 4, 16, 64 and 256
// frames before it. A rough estimate is enough: the jiggle's window grows with its logarithm. Throws as
// find_mesh_instances().
double measure_travel(const MarramFrame& frame, std::span<const MeshInstance> mesh_instances);

// Fills MeshInstance::past_transforms for the window. Returns true if an instance is elsewhere at a past
// sample than at the first motion sample. Throws as find_mesh_instances().
bool sample_past_transforms(const MarramFrame& frame, const Jiggle& jiggle, const JiggleWindow& window,
                            std::span<MeshInstance> mesh_instances);

// Transforms rest strands of the mesh to one of its instances. Does nothing if that is the mesh itself.
// noise_at_bind_frame: noise is sampled where the strands are at the bind frame.
void transform_strands(const MeshInstance& mesh_instance, const Eigen::Affine3d& transform,
                       bool noise_at_bind_frame, Strands& strands);
// Scales positions, widths and radii about the origin.
void scale_strands(Strands& strands, double scale);

} // namespace marram
