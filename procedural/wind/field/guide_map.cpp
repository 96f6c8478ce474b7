// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/field/guide_map.h"

#include "core/math/digest.h"
#include "procedural/abi/parallel.h"
#include "procedural/abi/values.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double samples_per_reach = 24.0, max_map_samples = 0x1p19, min_samples_per_reach = 2.0;

double distance_to(const GuideSegment& s, const Vec2d& p) {
    const Vec2d along = (s.b - s.a) / s.length;
    const double at = std::clamp((p - s.a).dot(along), 0.0, s.length);
    return (s.a + at * along - p).norm();
}

} // namespace

uint64_t guide_digest(std::span<const DrawnCurve> curves, double reach, const Ramp& ramp) {
    Digest digest;
    digest.add(&reach, sizeof reach);
    for (const DrawnCurve& curve : curves) {
        digest.add(uint64_t(curve.closed)).add(curve.points.size());
        for (const Vec3d& p : curve.points) digest.add(p.data(), 3 * sizeof(double));
    }
    for (const double number : ramp.positions()) digest.add(&number, sizeof number);
    for (const double number : ramp.values()) digest.add(&number, sizeof number);
    return digest.add(uint64_t(ramp.interpolation())).value();
}

PlanMap guide_map(std::span<const DrawnCurve> curves, double reach, const Ramp& ramp,
                  const std::string& place) {
    Eigen::AlignedBox2d box;
    for (const DrawnCurve& curve : curves)
        for (const Vec3d& p : curve.points) box.extend(Vec2d(p.x(), p.z()));
    const std::vector<GuideSegment> segments =
        box.isEmpty() ? std::vector<GuideSegment>() : guide_segments(curves, reach / samples_per_reach, box);
    if (segments.empty())
        throw SceneFault("field.no_curves", place, "the curves of this field have no length seen from above",
                         "give each two different points or more");
    const Vec2d size = box.sizes() + Vec2d::Constant(2.0 * guide_extent * reach);
    const double cell = std::max(reach / samples_per_reach, std::sqrt(size.prod() / max_map_samples));
    if (!(cell * min_samples_per_reach <= reach) || !size.allFinite())
        throw SceneFault(
            "field.short_reach", place,
            fmt::format("its curves cover {:.3g} x {:.3g} m, too much for a reach of {:g} m", size.x(),
                        size.y(), reach),
            fmt::format("give a reach of {:.2g} m or more, or fields of their own to curves far apart",
                        cell * min_samples_per_reach));
    PlanMap map;
    map.channels = 4;
    map.nx = int(std::ceil(size.x() / cell)) + 2,
    map.nz = int(std::ceil(size.y() / cell)) + 2; // its border is 0
    map.center = box.center();
    map.half = 0.5 * cell * Vec2d(map.nx, map.nz);
    map.digest = guide_digest(curves, reach, ramp);
    map.values.resize(4 * size_t(map.nx) * size_t(map.nz));
    parallel_for(0, map.nz, [&](int j) {
        for (int i = 0; i < map.nx; ++i) {
            const Vec2d p = map.center - map.half + cell * Vec2d(i + 0.5, j + 0.5);
            double weights = 0.0, nearest = guide_extent * reach;
            Vec2d towards = Vec2d::Zero();
            for (const GuideSegment& s : segments) nearest = std::min(nearest, distance_to(s, p));
            const double influence = ramp(nearest / (guide_extent * reach));
            for (size_t s = 0; s < segments.size() && influence > 0.0; ++s) {
                const double w = guide_weight(p, segments[s], cell);
                weights += w;
                towards += w / segments[s].length * (segments[s].b - segments[s].a);
            }
            const double factor = influence / (pi / reach + weights);
            float* const out = map.values.data() + 4 * (size_t(j) * size_t(map.nx) + size_t(i));
            out[0] = float(weights * factor);
            out[1] = float(towards.x() * factor), out[2] = float(towards.y() * factor);
            out[3] = float(influence);
        }
    });
    return map;
}

PlanMap image_map(const MarramGrid& image, const std::string& place) {
    if (image.components < 2)
        throw SceneFault("field.channels", place, "the map of this field has one channel",
                         "give the wind along and across its direction as red and green");
    PlanMap map;
    map.channels = 2;
    map.nx = int(image.nx), map.nz = int(image.ny);
    map.values.resize(2 * size_t(image.nx) * size_t(image.ny));
    constexpr float strongest = 10.0F;
    for (size_t p = 0; p < map.values.size() / 2; ++p)
        for (size_t c = 0; c < 2; ++c) {
            const float value = image.values[p * image.components + c];
            if (!(std::abs(value) <= strongest))
                throw SceneFault("field.map", place,
                                 fmt::format("the map of this field has the value {:g} in pixel ({}, {})",
                                             value, p % image.nx, p / image.nx),
                                 fmt::format("keep it within -{0:g} to {0:g} times the wind", strongest));
            map.values[2 * p + c] = value;
        }
    return map;
}

} // namespace marram
