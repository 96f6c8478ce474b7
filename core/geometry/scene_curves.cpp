// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/scene_curves.h"

#include "core/math/digest.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace marram {

bool SceneCurves::select_take(double frame) {
    if (takes.empty()) return false;
    const auto next = std::ranges::upper_bound(takes, frame, {}, &CurvesTake::frame);
    const CurvesTake& take = next == takes.begin() ? takes.front() : *(next - 1);
    if (take.offsets == offsets && take.vertices == vertices) return false;
    offsets = take.offsets;
    vertices = take.vertices;
    attributes = take.attributes;
    closed.assign(offsets.size() - 1, 0);
    return true;
}

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

void SceneCurves::vertices_at(double frame, uint64_t first_curve, uint64_t count, float* out) const {
    const CurveLayout curves = layout();
    const size_t first = 4 * curves.first_vertex(first_curve),
                 size = 4 * curves.first_vertex(first_curve + count) - first;
    const float *a = vertices.data() + first, *b = nullptr;
    double share = 0.0;
    if (samples.size() > 1) {
        const auto next = std::ranges::upper_bound(samples, frame, {}, &CurvesSample::frame);
        if (next == samples.end()) {
            a = samples.back().vertices.data() + first;
        } else if (next != samples.begin()) {
            a = (next - 1)->vertices.data() + first;
            b = next->vertices.data() + first;
            share = (frame - (next - 1)->frame) / (next->frame - (next - 1)->frame);
        }
    }
    if (share > 0.0)
        for (size_t i = 0; i < size; ++i)
            out[i] = float(double(a[i]) + share * (double(b[i]) - double(a[i])));
    else
        std::copy_n(a, size, out);
    const Eigen::Affine3d placed = transform.at(frame);
    if (placed.matrix() == Eigen::Affine3d::Identity().matrix()) return;
    const double widening = std::cbrt(std::abs(placed.linear().determinant()));
    for (size_t i = 0; i < size; i += 4) {
        const Vec3d p = placed * Vec3d(double(out[i]), double(out[i + 1]), double(out[i + 2]));
        for (size_t axis = 0; axis < 3; ++axis) out[i + axis] = float(p[long(axis)]);
        out[i + 3] = float(widening * double(out[i + 3]));
    }
}

std::vector<float> SceneCurves::vertices_at(double frame) const {
    std::vector<float> at(vertices.size());
    constexpr uint64_t at_once = 4096;
    tbb::parallel_for(uint64_t{0}, (closed.size() + at_once - 1) / at_once, [&](uint64_t i) {
        const uint64_t first = i * at_once, count = std::min<uint64_t>(at_once, closed.size() - first);
        vertices_at(frame, first, count, at.data() + 4 * layout().first_vertex(first));
    });
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

std::map<std::string, std::vector<AttributeValues>> attributes_of(std::span<const SceneCurves> curves) {
    std::map<std::string, std::vector<AttributeValues>> all;
    for (const SceneCurves& one : curves)
        for (const AttributeValues& a : one.attributes)
            all[one.name].push_back({a.name, a.components, a.rate, {}, a.discrete, a.animated});
    return all;
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
