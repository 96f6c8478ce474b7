// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/made_strands.h"

#include "core/math/digest.h"
#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"
#include "procedural/strands/grown/groom_instance.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace marram {
namespace {

// The share at a place on a mesh instance, whose widths scale with it; `reach`: of what is around the place.
double share_at(const GroomInstance& instance, const MeshInstance& on, const Vec3d& place, double reach) {
    return instance.lod->share_at((instance.lod->distance_of(place) - reach) /
                                  uniform_scale(on.transform(0)));
}

// Adds those of the roots that are below the share where they are on a mesh instance.
void add_level(const GroomInstance& instance, const MeshInstance& on, MadeStrands& made) {
    const std::vector<Root>& roots = instance.roots;
    const Surface now = instance.poses(0).now;
    const uint32_t seed = instance.groom.seed;
    std::vector<float> factors(roots.size());
    marram::parallel_for(tbb::blocked_range<size_t>(0, roots.size(), 4096), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const Vec3d at = on.transform(0) * now.point(roots[i].triangle, root_weights(seed, roots[i]));
            factors[i] = float(width_factor(double(instance.ranks[i]), share_at(instance, on, at, 0.0)));
        }
    });
    for (size_t i = 0; i < roots.size(); ++i) {
        if (!(factors[i] > 0.0F)) continue;
        ++made.all_curves;
        if (made.share < 1.0 && unit_double(root_hash(seed, roots[i], Purpose::share)) >= made.share)
            continue;
        made.roots.push_back(roots[i]);
        if (!instance.blends.empty()) made.blends.push_back(instance.blends[i]);
        made.width_factors.push_back(factors[i]);
        made.widest = std::max(made.widest, double(factors[i]));
    }
}

// Adds the roots of a preview's share: they depend on the hash of each alone.
void add_share(const GroomInstance& instance, MadeStrands& made) {
    for (size_t i = 0; i < instance.roots.size(); ++i) {
        const Root root = instance.roots[i];
        if (unit_double(root_hash(instance.groom.seed, root, Purpose::share)) >= made.share) continue;
        made.roots.push_back(root);
        if (!instance.blends.empty()) made.blends.push_back(instance.blends[i]);
    }
}

} // namespace

std::optional<LevelOfDetail> level_of_detail_of(const Groom& groom, const MarramFrame& frame) {
    const auto profile = groom.width_profile.values();
    const double widest = groom.width * (profile.empty() ? 1.0 : *std::ranges::max_element(profile));
    if (!groom.level_of_detail || !frame.view || !(widest > 0.0)) return std::nullopt;
    return LevelOfDetail(known_part(frame.view), widest);
}

uint64_t digest_of_levels(const GroomInstance& instance) {
    if (!instance.lod) return 0;
    Digest digest;
    digest.add(std::bit_cast<uint64_t>(instance.lod->full));
    for (const Vec3d& camera : instance.lod->cameras) digest.add(camera.data(), sizeof camera);
    for (const MeshInstance& on : instance.mesh_instances)
        digest.add(on.transform(0).data(), 16 * sizeof(double));
    const MarramMesh& mesh = *instance.mesh;
    if (mesh.time_count > 1 || mesh.moves != 0) digest.add(mesh.positions[0], 12 * size_t(mesh.vertex_count));
    return digest.value();
}

ShareAround share_around(const GroomInstance& instance) {
    if (!instance.lod) return {};
    return [&instance, now = instance.poses(0).now](uint32_t triangle, double margin) {
        const auto p = now.corners(triangle);
        const Vec3d centre = (p[0] + p[1] + p[2]) / 3.0;
        double radius = margin, share = 0.0;
        for (const Vec3d& corner : p) radius = std::max(radius, margin + (corner - centre).norm());
        for (const MeshInstance& on : instance.mesh_instances) {
            const Eigen::Affine3d& transform = on.transform(0);
            share = std::max(share,
                             share_at(instance, on, transform * centre, uniform_scale(transform) * radius));
            if (share == 1.0) break;
        }
        return share;
    };
}

MadeStrands choose_strands(const GroomInstance& instance) {
    MadeStrands made;
    if (instance.frame.share > 0.0 && instance.frame.share < 1.0) made.share = instance.frame.share;
    made.all = made.share == 1.0 && !instance.lod;
    if (!made.all && !instance.lod) add_share(instance, made);
    for (const MeshInstance& on : instance.mesh_instances) {
        MadeStrands::OnInstance& strands = made.on.emplace_back();
        strands.first_curve = made.curves;
        if (instance.lod) {
            strands.begin = made.roots.size();
            add_level(instance, on, made);
        }
        strands.count = (made.all ? instance.roots.size() : made.roots.size()) - strands.begin;
        made.curves += strands.count;
        if (!instance.lod) made.all_curves += instance.roots.size();
    }
    if (!made.all)
        made.digest = Digest()
                          .add(made.roots.data(), made.roots.size() * sizeof(Root))
                          .add(made.width_factors.data(), made.width_factors.size() * sizeof(float))
                          .value();
    return made;
}

void MadeStrands::number_patches(uint32_t strands_a_patch) {
    patches = 0;
    for (OnInstance& strands : on) {
        strands.first_patch = patches;
        patches += uint32_t((strands.count + strands_a_patch - 1) / strands_a_patch);
    }
}

} // namespace marram
