// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/mesh_instances.h"

#include "procedural/abi/border.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {

double uniform_scale(const Eigen::Affine3d& transform) {
    return std::cbrt(std::abs(transform.linear().determinant()));
}

double max_instance_scale(std::span<const MeshInstance> mesh_instances) {
    double most = 0.0;
    for (const MeshInstance& mesh_instance : mesh_instances) {
        for (const auto& transform : mesh_instance.transforms)
            most = std::max(most, uniform_scale(transform));
        for (const auto& transform : mesh_instance.past_transforms)
            most = std::max(most, uniform_scale(transform));
    }
    return most;
}

Eigen::AlignedBox3d transformed_box(const Eigen::Affine3d& transform, const Eigen::AlignedBox3d& box) {
    Eigen::AlignedBox3d out;
    if (box.isEmpty()) return out;
    for (int corner = 0; corner < 8; ++corner)
        out.extend(Vec3d(transform * box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner))));
    return out;
}

std::vector<MeshInstance> find_mesh_instances(const MarramFrame& frame, const MarramMesh& mesh) {
    std::vector<MeshInstance> mesh_instances(1, MeshInstance{&mesh});
    const auto instance_of = uint32_t(&mesh - frame.meshes) + 1; // of its instances
    for (uint32_t m = 0; m < frame.mesh_count; ++m) {
        if (frame.meshes[m].instance_of != instance_of) continue;
        MeshInstance mesh_instance{&frame.meshes[m], true};
        mesh_instance.transform_at_bind = place_lent_instance(frame, m, frame.bind_frame);
        mesh_instance.transforms.clear();
        for (uint32_t t = 0; t < frame.time_count; ++t)
            mesh_instance.transforms.push_back(place_lent_instance(frame, m, frame.times[t]));
        const auto same = [&](const Eigen::Affine3d& transform) {
            return transform.matrix() == mesh_instance.transforms[0].matrix();
        };
        if (std::ranges::all_of(mesh_instance.transforms, same)) mesh_instance.transforms.resize(1);
        mesh_instances.push_back(std::move(mesh_instance));
    }
    return mesh_instances;
}

double measure_travel(const MarramFrame& frame, std::span<const MeshInstance> mesh_instances) {
    if (mesh_instances.size() == 1) return 0.0; // no instances
    double travel = 0.0;
    Eigen::AlignedBox3d box;
    const MarramMesh& mesh = *mesh_instances[0].mesh;
    for (size_t v = 0; v < mesh.vertex_count; ++v)
        box.extend(Eigen::Map<const Vec3f>(mesh.positions[0] + 3 * v).cast<double>());
    for (const MeshInstance& mesh_instance : mesh_instances) {
        if (!mesh_instance.is_instance) continue;
        for (const double back : {1.0, 4.0, 16.0, 64.0, 256.0}) {
            const Eigen::Affine3d then = place_lent_instance(
                frame, uint32_t(mesh_instance.mesh - frame.meshes), frame.times[0] - back);
            for (int c = 0; c < 8 && !box.isEmpty(); ++c) {
                const Vec3d corner = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(c));
                travel = std::max(travel, (mesh_instance.transform(0) * corner - then * corner).norm());
            }
        }
    }
    return travel;
}

bool sample_past_transforms(const MarramFrame& frame, const Jiggle& jiggle, const JiggleWindow& window,
                            std::span<MeshInstance> mesh_instances) {
    bool moved = false;
    for (MeshInstance& mesh_instance : mesh_instances) {
        if (!mesh_instance.is_instance) continue;
        check_past_samples(jiggle, double(window.count()));
        const auto mesh = uint32_t(mesh_instance.mesh - frame.meshes);
        mesh_instance.past_transforms.clear();
        for (int64_t past_sample = window.first; past_sample <= window.last; ++past_sample)
            mesh_instance.past_transforms.push_back(
                place_lent_instance(frame, mesh, jiggle.frame_of(past_sample)));
        moved = moved || mesh_instance.moved();
    }
    return moved;
}

namespace {

struct WideMap {
    std::array<std::array<VDouble, 3>, 3> linear;
    Wide3d translation;

    explicit WideMap(const Eigen::Affine3d& transform) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) linear[size_t(i)][size_t(j)] = splat(transform.linear()(i, j));
        translation = splat3(transform.translation().data());
    }
    Wide3d direction(const Wide3d& v) const {
        const auto row = [&](size_t i) {
            return linear[i][0] * v.x + linear[i][1] * v.y + linear[i][2] * v.z;
        };
        return {row(0), row(1), row(2)};
    }
    Wide3d operator()(const Wide3d& p) const { return direction(p) + translation; }
};

} // namespace

void transform_strands(const MeshInstance& mesh_instance, const Eigen::Affine3d& transform,
                       bool noise_at_bind_frame, Strands& strands) {
    if (!mesh_instance.is_instance) return;
    const double scale = uniform_scale(transform);
    const WideMap map(transform),
        noise_map(noise_at_bind_frame ? mesh_instance.transform_at_bind : transform);
    Eigen::Affine3d unscaled = transform; // normals keep their length and, if mirrored, their side
    unscaled.linear() /= scale;
    const WideMap unscaled_map(unscaled);
    for (Wide3f& rest : strands.rest) rest = to_float(map(to_double(rest)));
    for (Wide3f& normal : strands.rest_normal) normal = to_float(unscaled_map.direction(to_double(normal)));
    for (Wide3d& origin : strands.noise_origin) origin = noise_map(origin);
    for (Wide3d& normal : strands.root_normal) normal = unscaled_map.direction(normal);
    for (VDouble& width : strands.width) width = width * splat(scale);
    for (VFloat& radius : strands.radius) radius = radius * splat_float(float(scale));
}

void scale_strands(Strands& strands, double scale) {
    if (scale == 1.0) return;
    const Eigen::Affine3d scaling(Eigen::Scaling(scale));
    transform_strands({nullptr, true, scaling}, scaling, false, strands);
}

} // namespace marram
