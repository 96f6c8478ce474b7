// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/scene_curves.h"

#include "core/math/digest.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace marram {

bool SceneCurves::moves_within(double begin, double end) const {
    return transform.moves_within(begin, end) ||
           (samples.size() > 1 && samples.front().frame < end && samples.back().frame > begin && begin < end);
}

std::vector<double> SceneCurves::bends_within(double begin, double end) const {
    std::vector<double> bends = transform.frames();
    for (const CurvesSample& sample : samples) bends.push_back(sample.frame);
    std::erase_if(bends, [&](double frame) { return !(frame > begin && frame < end); });
    std::ranges::sort(bends);
    bends.erase(std::unique(bends.begin(), bends.end()), bends.end());
    return bends;
}

std::vector<float> SceneCurves::vertices_at(double frame) const {
    std::vector<float> at = vertices;
    if (samples.size() > 1) {
        const auto next = std::ranges::upper_bound(samples, frame, {}, &CurvesSample::frame);
        if (next == samples.end()) {
            at = samples.back().vertices;
        } else if (next != samples.begin()) {
            const CurvesSample &a = *(next - 1), &b = *next;
            const double share = (frame - a.frame) / (b.frame - a.frame);
            for (size_t i = 0; i < at.size(); ++i)
                at[i] =
                    float(double(a.vertices[i]) + share * (double(b.vertices[i]) - double(a.vertices[i])));
        }
    }
    const Eigen::Affine3d placed = transform.at(frame);
    if (placed.matrix() == Eigen::Affine3d::Identity().matrix()) return at;
    const double widening = std::cbrt(std::abs(placed.linear().determinant()));
    for (size_t i = 0; i + 3 < at.size(); i += 4) {
        const Vec3d p = placed * Vec3d(double(at[i]), double(at[i + 1]), double(at[i + 2]));
        for (size_t axis = 0; axis < 3; ++axis) at[i + axis] = float(p[long(axis)]);
        at[i + 3] = float(widening * double(at[i + 3]));
    }
    return at;
}

void SceneCurves::add(std::span<const Vec3d> points, bool is_closed) {
    const auto put = [&](const Vec3d& p) {
        vertices.insert(vertices.end(), {float(p.x()), float(p.y()), float(p.z()), 0.0F});
    };
    put(2.0 * points[0] - points[1]);
    for (const Vec3d& p : points) put(p);
    put(2.0 * points[points.size() - 1] - points[points.size() - 2]);
    offsets.push_back(offsets.back() + points.size());
    closed.push_back(is_closed ? 1 : 0);
}

uint64_t SceneCurves::digest() const {
    Digest digest;
    digest.add(uint64_t(basis)).add(offsets).add(vertices).add(closed).add(transform.digest());
    for (const AttributeValues& attribute : attributes)
        digest.add(attribute.name)
            .add(attribute.components)
            .add(uint64_t(attribute.rate))
            .add(attribute.values)
            .add(uint64_t(attribute.discrete))
            .add(uint64_t(attribute.animated));
    for (const CurvesSample& sample : samples)
        digest.add(std::bit_cast<uint64_t>(sample.frame)).add(sample.vertices);
    return digest.value();
}

} // namespace marram
