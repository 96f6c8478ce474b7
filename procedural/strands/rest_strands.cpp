// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/rest_strands.h"

namespace marram {

void transform_to_instance(const GroomInstance& instance, const MeshInstance& mesh_instance, uint32_t time,
                           Strands& strands) {
    transform_strands(mesh_instance, mesh_instance.transform(time), instance.wind.noise_at_bind_frame,
                      strands);
}

RestStrandSource rest_strand_source(const GroomInstance& instance, const MeshInstance& mesh_instance,
                                    LayOutStrands lay_out, StageClock* clock) {
    const auto transform_at = [&instance, &mesh_instance](int64_t past_sample) -> const Eigen::Affine3d& {
        return mesh_instance.past_transform(size_t(past_sample - instance.past.window.first));
    };
    return {[&instance, &mesh_instance, lay_out, clock](uint32_t time, Strands& strands) {
                StageClock not_measured;
                const StageTimer timer((clock ? *clock : not_measured).expand);
                lay_out(instance.poses(time).now, strands);
                transform_to_instance(instance, mesh_instance, time, strands);
            },
            [&instance, &mesh_instance, lay_out, transform_at](int64_t past_sample, Strands& strands) {
                Surface then = instance.past.at(past_sample, *instance.mesh);
                then.attributes = instance.attributes;
                lay_out(then, strands);
                transform_strands(mesh_instance, transform_at(past_sample), instance.wind.noise_at_bind_frame,
                                  strands);
            },
            {},
            [&instance, transform_at](int64_t a, int64_t b) {
                return instance.past.same_at(a, b) && transform_at(a).matrix() == transform_at(b).matrix();
            },
            instance.mesh->time_count > 1 || mesh_instance.moves(),
            has_a_past(*instance.mesh) || mesh_instance.moved()};
}

} // namespace marram
