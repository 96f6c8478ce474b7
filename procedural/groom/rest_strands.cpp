// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/rest_strands.h"

namespace marram {
namespace {

void transform_by(const GroomInstance& instance, const MeshInstance& mesh_instance,
                  const Eigen::Affine3d& transform, Strands& strands) {
    if (!mesh_instance.is_instance) return;
    transform_strands(transform, instance.wind.rest_anchored ? mesh_instance.transform_at_bind : transform,
                      strands);
}

} // namespace

void transform_to_instance(const GroomInstance& instance, const MeshInstance& mesh_instance, uint32_t time,
                           Strands& strands) {
    transform_by(instance, mesh_instance, mesh_instance.transform(time), strands);
}

RestStrandSource rest_strand_source(const GroomInstance& instance, const MeshInstance& mesh_instance,
                                    LayOutStrands lay_out, StageClock* clock) {
    const auto at_knot = [&instance, &mesh_instance](int64_t knot) -> const Eigen::Affine3d& {
        return mesh_instance.is_instance
                   ? mesh_instance.transforms_at_knots[size_t(knot - instance.past.window.first)]
                   : mesh_instance.transforms[0];
    };
    return {[&instance, &mesh_instance, lay_out, clock](uint32_t time, Strands& strands) {
                StageClock not_measured;
                const StageTimer timer((clock ? *clock : not_measured).expand);
                lay_out(instance.poses(time).now, strands);
                transform_to_instance(instance, mesh_instance, time, strands);
            },
            [&instance, &mesh_instance, lay_out, at_knot](int64_t knot, Strands& strands) {
                Surface then = instance.past.at(knot, *instance.mesh);
                then.attributes = instance.attributes;
                lay_out(then, strands);
                transform_by(instance, mesh_instance, at_knot(knot), strands);
            },
            [&instance, at_knot](int64_t knot) {
                return instance.past.rests_at(knot) && at_knot(knot).matrix() == at_knot(knot - 1).matrix();
            }};
}

} // namespace marram
