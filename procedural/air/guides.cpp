// SPDX-License-Identifier: Apache-2.0
#include "procedural/air/guides.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace marram {
namespace {

// The CVs of curve c, without the phantom vertices before the first and after the last (MarramCurves).
DrawnCurve drawn_curve(const MarramCurves& curves, uint64_t c) {
    const uint64_t first = curves.offsets ? curves.offsets[c] + 2 * c : c * (curves.cvs_per_curve + 2);
    const uint64_t count = curves.offsets ? curves.offsets[c + 1] - curves.offsets[c] : curves.cvs_per_curve;
    DrawnCurve drawn;
    drawn.closed = curves.closed && curves.closed[c] != 0;
    for (uint64_t k = 0; k < count; ++k) {
        const float* v = curves.vertices[0] + 4 * (first + 1 + k);
        drawn.points.emplace_back(double(v[0]), double(v[1]), double(v[2]));
    }
    return drawn;
}

} // namespace

std::vector<DrawnCurve> drawn_curves(const MarramCurves& curves) {
    std::vector<DrawnCurve> list;
    for (uint64_t c = 0; c < curves.curve_count; ++c) list.push_back(drawn_curve(curves, c));
    return list;
}

std::vector<GuideSegment> guide_segments(std::span<const DrawnCurve> curves, double cell,
                                         const Eigen::AlignedBox2d& box) {
    std::vector<GuideSegment> segments;
    for (const DrawnCurve& curve : curves) {
        if (curve.points.empty()) continue;
        const size_t count = curve.points.size() + (curve.closed ? 1 : 0);
        std::optional<Vec2d> a;
        for (size_t k = 0; k < count; ++k) {
            const Vec3d& point = curve.points[k % curve.points.size()];
            const Vec2d b(point.x(), point.z());
            const Vec2d along = a ? Vec2d(b - *a) : Vec2d::Zero();
            const bool last = k + 1 == count && along.squaredNorm() > 0.0;
            if (a && !last && !(along.norm() >= std::max(2.0 * cell, 0.1 * box.exteriorDistance(b))))
                continue;
            if (a) segments.push_back({*a, b, along.norm()});
            a = b;
        }
    }
    return segments;
}

double guide_weight(const Vec2d& p, const GuideSegment& segment, double cell) {
    const Vec2d along = (segment.b - segment.a) / segment.length, to = segment.a - p;
    const double begin = to.dot(along), across = along.x() * to.y() - along.y() * to.x();
    const double q = std::hypot(across, cell);
    return (std::atan((begin + segment.length) / q) - std::atan(begin / q)) / q;
}

} // namespace marram
