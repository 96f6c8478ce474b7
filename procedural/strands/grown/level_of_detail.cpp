// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/level_of_detail.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram {
namespace {

constexpr double most_fading = 0.2; // greatest t

} // namespace

LevelOfDetail::LevelOfDetail(const MarramView& view, double width) {
    constexpr double half = 0.5; // a pixel
    const double tolerance = view.tolerance_pixels > 0.0 ? view.tolerance_pixels : half;
    full = width / (tolerance * 2.0 * std::tan(0.5 * view.fov) / view.height);
    for (uint32_t t = 0; t < view.time_count; ++t) cameras.emplace_back(view.positions + 3 * t);
}

// The solution of W(s) = 1 / x.
double LevelOfDetail::share_at(double distance) const {
    if (distance <= full) return 1.0;
    const double x = full / distance, share = x / (1.0 - 0.5 * most_fading);
    if (share <= 1.0 - most_fading) return share;
    return 0.5 * (std::sqrt(1.0 + 8.0 * x) - 1.0); // t = 1 - s: s (1 + s) / 2 = x
}

double LevelOfDetail::distance_of(const Vec3d& p) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Vec3d& camera : cameras) nearest = std::min(nearest, (p - camera).squaredNorm());
    return std::sqrt(nearest);
}

double width_factor(double rank, double share) {
    if (rank >= share) return 0.0;
    const double t = std::min(most_fading, 1.0 - share), widened = 1.0 / (share * (1.0 - 0.5 * t));
    return rank <= share * (1.0 - t) ? widened : widened * (share - rank) / (share * t);
}

} // namespace marram
