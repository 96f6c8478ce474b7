// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/density_mask.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// Greatest value of a ramp over an interval: between two ramp points it is monotone.
double greatest(const Ramp& ramp, double low, double high) {
    double most = std::max(ramp(low), ramp(high));
    for (size_t i = 0; i < ramp.positions().size(); ++i)
        if (ramp.positions()[i] > low && ramp.positions()[i] < high) most = std::max(most, ramp.values()[i]);
    return most;
}

} // namespace

bool may_grow(const DensityMask& mask, uint32_t triangle) {
    const Masks& masks = mask.groom.density_masks;
    const auto p = mask.bind.corners(triangle);
    if (masks.image && masks.image->high() <= 0.0) return false;
    if (masks.by_slope) {
        const Vec3d n = plane_normal(p);
        if ((*masks.by_slope)(std::atan2(std::hypot(n.x(), n.z()), n.y()) / degree) <= 0.0) return false;
    }
    if (masks.by_height) {
        const double low = std::min({p[0].y(), p[1].y(), p[2].y()}),
                     high = std::max({p[0].y(), p[1].y(), p[2].y()});
        if (greatest(*masks.by_height, low, high) <= 0.0) return false;
    }
    for (const Factor& factor : masks.factors) {
        const auto [low, high] = factor.input_range(mask.bind, triangle);
        if (greatest(factor.ramp, low, high) <= 0.0) return false;
    }
    return true;
}

MaskStatistics mask_statistics(const DensityMask& mask, double area) {
    if (!mask.masked()) return {};
    constexpr uint32_t points = 1U << 18;
    double sum = 0.0, most = 0.0, passed = 0.0;
    uint32_t sample_count = 0; // one point per area / points, in the order of the triangles
    for (uint32_t t = 0; t < mask.bind.triangle_count; ++t) {
        passed += mask.bind.area(t);
        for (uint32_t i = 0; sample_count < points && (sample_count + 0.5) * area < passed * points;
             ++sample_count, ++i) {
            const double share = mask.at(t, root_weights(~mask.groom.seed, {t, i}));
            sum += share;
            most = std::max(most, share);
        }
    }
    return {sum / points, most};
}

} // namespace marram
