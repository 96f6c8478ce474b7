// SPDX-License-Identifier: Apache-2.0
#include "core/world/lazy_choice.h"

#include "core/world/curve_memory.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace marram {
namespace {

constexpr uint64_t small_bytes = 1'000'000'000;
constexpr double most_in_view = 0.5;

} // namespace

bool is_lazy(const Build& build, const CurveBuild& item) {
    const BuildSettings& settings = build.settings;
    const auto reads_it = [&](const auto& other) { return other->names(item.procedural->name()); };
    if (settings.lazy == Lazy::never || !settings.trace_curves || item.patches.size() < 2 ||
        item.output.curve_count == 0 || std::ranges::any_of(build.geometry.procedurals, reads_it))
        return false;
    if (settings.lazy == Lazy::always) return true;
    return settings.camera && curve_memory(item, 0).total() >= small_bytes &&
           share_in_view(item.patches, *settings.camera) < most_in_view;
}

// By the sphere around a box and the pyramid of the view.
double share_in_view(std::span<const MarramPatch> patches, const CameraSamples& camera) {
    const double up = std::tan(0.5 * camera.fov), right = up * camera.width / camera.height;
    const auto in_view = [&](const Vec3d& center, double radius, size_t i) {
        const Vec3d to = center - camera.positions[i], side = camera.directions[i].cross(camera.ups[i]);
        const double ahead = to.dot(camera.directions[i]);
        const auto inside = [&](double off, double tangent) {
            return std::abs(off) - tangent * ahead <= radius * std::hypot(1.0, tangent);
        };
        return ahead >= -radius && inside(to.dot(side), right) && inside(to.dot(camera.ups[i]), up);
    };
    uint64_t all = 0, seen = 0;
    for (const MarramPatch& patch : patches) {
        const Eigen::AlignedBox3d box(Vec3f(patch.lower).cast<double>(), Vec3f(patch.upper).cast<double>());
        const double radius = 0.5 * box.diagonal().norm();
        bool is_seen = false;
        for (size_t i = 0; i < camera.positions.size() && !is_seen; ++i)
            is_seen = in_view(box.center(), radius, i);
        all += patch.curve_count;
        seen += is_seen ? patch.curve_count : 0;
    }
    return all > 0 ? double(seen) / double(all) : 0.0;
}

std::vector<uint32_t> patches_to_look_at(const CurveBuild& item, const View& view) {
    constexpr uint32_t nearest = 16, spread = 48;
    const auto count = uint32_t(item.patches.size());
    std::vector<std::pair<double, uint32_t>> by_distance(count);
    for (uint32_t i = 0; i < count; ++i) {
        const Eigen::AlignedBox3d box(Vec3f(item.patches[i].lower).cast<double>(),
                                      Vec3f(item.patches[i].upper).cast<double>());
        by_distance[i] = {box.squaredExteriorDistance(view.position), i};
    }
    const uint32_t near = std::min(nearest, count);
    std::ranges::partial_sort(by_distance, by_distance.begin() + near);
    std::set<uint32_t> chosen;
    for (uint32_t i = 0; i < near; ++i) chosen.insert(by_distance[i].second);
    for (uint32_t i = 0; i < std::min(spread, count); ++i)
        chosen.insert(uint32_t(uint64_t(i) * (count - 1) / std::max(std::min(spread, count) - 1, 1U)));
    return {chosen.begin(), chosen.end()};
}

} // namespace marram
