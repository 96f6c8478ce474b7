// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/guide_motion.h"

#include "procedural/abi/parallel.h"
#include "procedural/strands/rest_strands.h"

#include <algorithm>
#include <numeric>

namespace marram {
namespace {

constexpr size_t guides_at_once = 256;

// Lays out the rest strands of some guides on the skin `now`.
void expand_guides(const GroomInstance& instance, const Surface& bind, const Surface& now, size_t first,
                   Strands& strands) {
    const GuideSet& set = *instance.guides;
    const auto cvs = size_t(strands.cvs);
    const auto offsets = set.resampled(strands.cvs);
    for (int block = 0; block < strands.blocks; ++block)
        for (int lane = 0; lane < lanes; ++lane) {
            const size_t i = std::min(size_t(block) * lanes + size_t(lane), size_t(strands.count) - 1);
            const GuideSet::Guide& guide = set.guide(first + i);
            const SurfaceFrame frame = frame_at(now, guide.triangle, guide.weights);
            const Eigen::Matrix3d rotation =
                axes_of(frame) * axes_of(frame_at(bind, guide.triangle, guide.weights)).transpose();
            const Vec3d root = now.point(guide.triangle, guide.weights);
            set_lane(strands.noise_origin[size_t(block)], lane,
                     instance.wind.noise_at_bind_frame ? guide.root : root);
            set_lane(strands.root_normal[size_t(block)], lane, frame.normal);
            strands.width[size_t(block)][lane] = 0.0;
            if (strands.has_wind_share) {
                strands.wind_share[size_t(block)][lane] =
                    float(product(instance.groom.factors[of_wind], now, guide.triangle, guide.weights));
            }
            for (size_t k = 0; k < cvs; ++k) {
                const Vec3d p = root + rotation * (*offsets)[(first + i) * cvs + k].cast<double>();
                set_lane(strands.rest[size_t(block) * cvs + k], lane, p);
            }
        }
}

// Stores blown guides. Offsets are transformed back to the space of the groom's mesh.
void store_blown_guides(const Strands& strands, const MeshInstance& mesh_instance, uint32_t time,
                        size_t first, BlownGuides& out) {
    const Eigen::Matrix3d back = mesh_instance.is_instance
                                     ? Eigen::Matrix3d(mesh_instance.transform(time).linear().inverse())
                                     : Eigen::Matrix3d::Identity();
    const auto cvs = size_t(strands.cvs);
    for (size_t i = 0; i < size_t(strands.count); ++i)
        for (size_t k = 0; k < cvs; ++k) {
            const size_t from = i / lanes * cvs, at = (first + i) * cvs + k;
            const auto lane = int(i % lanes);
            const Wide3f &p = strands.pose[from + k], &root = strands.pose[from];
            out.offsets[at] = {p.x[lane] - root.x[lane], p.y[lane] - root.y[lane], p.z[lane] - root.z[lane]};
            if (mesh_instance.is_instance)
                out.offsets[at] = (back * out.offsets[at].cast<double>()).cast<float>();
            out.envelope[at] = strands.envelope[from + k][lane];
            out.gust[at] = strands.gust[from + k][lane];
            out.shield[at] = strands.shield[from + k][lane];
        }
}

} // namespace

void blow_guides(GroomInstance& instance) {
    GuideMotion& motion = instance.guide_motion;
    motion.blown.clear();
    if (!instance.guides || !instance.groom.guides->wind_on_guides || instance.frame.stage == MARRAM_REST ||
        !wind_bends(instance.wind))
        return;
    const GuideSet& set = *instance.guides;
    const auto guided = instance.guided(0, 0);
    motion.wind = instance.wind;
    motion.wind.collision.reset();
    const ChainFrame chain =
        make_chain_frame({motion.wind, instance.groom.envelope, instance.frame, instance.mesh,
                          instance.radius_profile, instance.groom.basis, instance.past.window, everywhere(),
                          everywhere(), nullptr, nullptr, instance.ground, instance.canopy.get()});
    const size_t size = set.count() * size_t(instance.groom.cvs);
    motion.blown.resize(instance.mesh_instances.size());
    for (size_t i = 0; i < instance.mesh_instances.size(); ++i)
        for (uint32_t t = 0; t < instance.time_count; ++t) {
            BlownGuides& at = motion.blown[i].emplace_back();
            at.offsets.resize(size);
            at.envelope.resize(size);
            at.gust.resize(size);
            at.shield.resize(size);
            const Surface now = instance.poses(t).now;
            for (size_t g = 0; g < set.count(); ++g)
                at.normals.push_back(frame_at(now, set.guide(g).triangle, set.guide(g).weights).normal);
        }
    const size_t batches = (set.count() + guides_at_once - 1) / guides_at_once;
    marram::parallel_for(size_t{0}, batches * instance.mesh_instances.size(), [&](size_t job) {
        const size_t first = job % batches * guides_at_once,
                     count = std::min(guides_at_once, set.count() - first);
        const MeshInstance& mesh_instance = instance.mesh_instances[job / batches];
        Worker& worker = instance.workers.local();
        Strands& strands = worker.strands;
        strands.irregular = false;
        strands.has_wind_share = !instance.groom.factors[of_wind].empty();
        strands.resize(int(count), instance.groom.cvs, false);
        const auto lay_out = [&](const Surface& now, Strands& out) {
            expand_guides(instance, guided->skin, now, first, out);
        };
        const RestStrandSource rest_strands = rest_strand_source(instance, mesh_instance, lay_out, nullptr);
        const bool jiggles = !instance.past.window.empty();
        if (jiggles) {
            const StrandInstance::KeptState kept = instance.guide_state(job, strands);
            jiggle_patch(chain, rest_strands, strands, worker.chain, uint32_t(job % batches), kept.get());
        }
        for (uint32_t time = 0; time < instance.time_count; ++time) {
            if (rest_strands.moves || (time == 0 && !jiggles)) rest_strands.at_time(time, strands);
            run_chain(chain, time, strands, worker.chain);
            store_blown_guides(strands, mesh_instance, time, first, motion.blown[job / batches][time]);
        }
    });
}

void follow_guides(const GroomInstance& instance, const GroomPatch& patch, uint32_t time, Strands& strands) {
    const std::span<const Root> roots = patch.roots;
    const MeshInstance& mesh_instance = patch.mesh_instance;
    const BlownGuides& blown =
        instance.guide_motion.blown[size_t(&mesh_instance - instance.mesh_instances.data())][time];
    const std::optional<Guided> at_rest = instance.guided(roots);
    const Guided guided{at_rest->set, at_rest->blends, instance.poses(time).now, blown.offsets,
                        blown.normals};
    // expand() writes to rest and rest_normal. Swapped with pose and pose_normal, these get the blown
    // strands, and the rest strands are kept.
    std::swap(strands.rest, strands.pose);
    std::swap(strands.rest_normal, strands.pose_normal);
    expand(instance.groom, instance.wind, instance.poses(time), roots, strands, &guided);
    transform_to_instance(instance, mesh_instance, time, strands);
    std::swap(strands.rest, strands.pose);
    std::swap(strands.rest_normal, strands.pose_normal);
    const auto cvs = size_t(strands.cvs);
    for (size_t i = 0; i < size_t(strands.blocks) * lanes; ++i) {
        const GuideBlend& blend = at_rest->blends[std::min(i, roots.size() - 1)];
        const auto lane = int(i % lanes);
        for (size_t k = 0; k < cvs; ++k) {
            float envelope = 0.0F, gust = 0.0F, shield = 0.0F;
            for (int b = 0; b < max_blended; ++b) {
                if (!(blend.weight[b] > 0.0F)) continue;
                const size_t at = blend.guide[b] * cvs + k;
                envelope += blend.weight[b] * blown.envelope[at];
                gust += blend.weight[b] * blown.gust[at];
                shield += blend.weight[b] * blown.shield[at];
            }
            const size_t to = i / lanes * cvs + k;
            strands.envelope[to][lane] = envelope;
            strands.gust[to][lane] = gust;
            strands.shield[to][lane] = shield;
        }
    }
}

} // namespace marram
