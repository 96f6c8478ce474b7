// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/groom_canopy.h"

#include "procedural/abi/parallel.h"

#include <algorithm>

namespace marram {
namespace {

// Length, height and width of strands of four CVs.
CanopyStrand canopy_strand(const Strands& strands, size_t index, double mean_width) {
    const size_t block = index / lanes, first = block * size_t(strands.cvs);
    const int lane = int(index % lanes);
    const auto point = [&](int k) {
        const Wide3f& p = strands.rest[first + size_t(k)];
        return Vec3d(double(p.x[lane]), double(p.y[lane]), double(p.z[lane]));
    };
    double length = 0.0;
    for (int k = 0; k + 1 < strands.cvs; ++k) length += (point(k + 1) - point(k)).norm();
    const Wide3d& n = strands.root_normal[block];
    const Vec3d normal(n.x[lane], n.y[lane], n.z[lane]), root = point(0);
    double height = 0.0;
    for (int k = 1; k < strands.cvs; ++k) height = std::max(height, (point(k) - root).dot(normal));
    return {root.x(), root.z(), height, length * strands.width[block][lane] * mean_width};
}

// Of a strand of width 1.
double mean_width_of(const Groom& groom) {
    constexpr int samples = 64;
    double sum = 0.0;
    for (int k = 0; k < samples; ++k) sum += groom.width_profile((k + 0.5) / samples);
    return sum / samples;
}

} // namespace

void find_canopy(GroomInstance& instance) {
    if (!instance.groom.canopy) return;
    const auto refuse = [&](const char* what, const char* remedy) {
        throw SceneFault("groom.canopy", instance.groom.canopy_place, what, remedy);
    };
    if (instance.mesh_instances.size() > 1)
        refuse("a canopy is a stand on one mesh, and this one has instances",
               "remove canopy, or grow the strands on one mesh");
    if (instance.mesh->time_count > 1 || instance.mesh->moves != 0)
        refuse("a canopy is a stand on ground, and this mesh moves", "remove canopy, or keep the mesh still");
    const auto changes = [&](const Factors* factors) {
        return std::ranges::any_of(*factors, [](const Factor& factor) { return !factor.image; });
    };
    if (instance.canopy && std::ranges::none_of(factors_of(instance.groom), changes)) return;
    constexpr size_t batch = 512;
    // Those of a level of detail, and of a preview's share of it, stand for all.
    const std::span<const Root> roots = instance.lod ? instance.made.roots : std::span(instance.roots);
    const std::span<const float> factors = instance.made.width_factors;
    const size_t count = roots.size();
    std::vector<CanopyStrand> stand(count);
    Groom groom = instance.groom;
    groom.cvs = 4;
    const SkinPoses poses = instance.poses(0);
    const double mean_width = mean_width_of(groom);
    marram::parallel_for(size_t{0}, (count + batch - 1) / batch, [&](size_t b) {
        const size_t first = b * batch, size = std::min(batch, count - first);
        Strands strands;
        strands.has_wind_share = !groom.factors[of_wind].empty();
        strands.resize(int(size), groom.cvs, false);
        const std::span<const Root> some = roots.subspan(first, size);
        const auto guided = instance.lod ? instance.guided(some) : instance.guided(first, size);
        expand(groom, instance.wind, {poses.bind, poses.bind}, some, strands, guided ? &*guided : nullptr);
        for (size_t i = 0; i < size; ++i) {
            stand[first + i] = canopy_strand(strands, i, mean_width);
            if (!factors.empty()) stand[first + i].area *= double(factors[first + i]) / instance.made.share;
        }
    });
    instance.canopy = std::make_shared<const Canopy>(stand, groom.canopy_attenuation);
    if (count > 0 && !(instance.canopy->mean_index() > 0.0))
        refuse("a canopy of strands without width or height does nothing",
               "give them both, or remove canopy");
}

} // namespace marram
