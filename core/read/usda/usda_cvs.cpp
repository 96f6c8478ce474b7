// SPDX-License-Identifier: Apache-2.0
#include "core/read/usda/usda_cvs.h"

#include "core/geometry/cubic.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

constexpr size_t curves_a_task = 256;

struct UsdaWeights {
    std::array<double, 4> value, first; // first: the derivative's
};

UsdaWeights weights_at(UsdaCurveBasis basis, double t) {
    if (basis == UsdaCurveBasis::bezier) {
        const double r = 1.0 - t;
        return {{r * r * r, 3.0 * r * r * t, 3.0 * r * t * t, t * t * t},
                {-3.0 * r * r, 3.0 * r * (r - 2.0 * t), 3.0 * t * (2.0 * r - t), 3.0 * t * t}};
    }
    const CubicBasis cubic =
        cubic_basis(basis == UsdaCurveBasis::bspline ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM, t);
    return {cubic.value, cubic.first};
}

Vec3d weighted(const std::array<Vec3d, 4>& p, const std::array<double, 4>& w) {
    return w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + w[3] * p[3];
}

// Distance of a point from a cubic near t: an upper bound, lowered by two steps of Newton's method.
double distance_near(const Vec3d& point, const std::array<Vec3d, 4>& cubic, UsdaCurveBasis basis, double t,
                     double enough) {
    double least = std::numeric_limits<double>::infinity();
    for (int step = 0; step < 3; ++step) {
        const UsdaWeights weights = weights_at(basis, t);
        const Vec3d away = point - weighted(cubic, weights.value), along = weighted(cubic, weights.first);
        least = std::min(least, away.norm());
        if (least <= enough || !(along.squaredNorm() > 0.0)) break;
        t = std::clamp(t + away.dot(along) / along.squaredNorm(), 0.0, 1.0);
    }
    return least;
}

} // namespace

UsdaCvs::UsdaCvs(UsdaCurveKind kind, std::vector<uint32_t> counts, bool through_points)
    : kind_(kind), counts_(std::move(counts)) {
    const bool periodic = kind.wrap == UsdaCurveWrap::periodic,
               is_linear = kind.basis == UsdaCurveBasis::linear;
    keeps_vertices_ =
        is_linear ? !periodic : kind.wrap == UsdaCurveWrap::pinned && kind.basis != UsdaCurveBasis::bezier;
    if (through_points && kind.basis == UsdaCurveBasis::bspline) keeps_vertices_ = false;
    vertices_.assign(1, 0);
    joints_.assign(1, 0);
    for (const uint32_t count : counts_) {
        vertices_.push_back(vertices_.back() + count);
        joints_.push_back(joints_.back() + kind_.segments(count) + (periodic || count == 0 ? 0 : 1));
    }
    cut(1);
}

MarramBasis UsdaCvs::basis() const {
    if (kind_.basis == UsdaCurveBasis::linear) return MARRAM_LINEAR;
    return keeps_vertices_ && kind_.basis == UsdaCurveBasis::bspline ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM;
}

uint32_t UsdaCvs::pattern_of(size_t curve, uint32_t cubic) const {
    if (corners_.empty()) return 0;
    const uint64_t joint = joints_[curve] + cubic, next = joint + 1;
    const bool at_end = next < joints_[curve + 1] && corners_[next] != 0;
    return (corners_[joint] != 0 ? 1U : 0U) + (at_end ? 2U : 0U);
}

void UsdaCvs::cut(uint32_t pieces) {
    for (uint32_t pattern = 0; pattern < patterns_.size(); ++pattern) {
        std::vector<double>& at = patterns_[pattern];
        at.clear();
        for (uint32_t k = 0; k <= pieces; ++k) {
            if (k == pieces && (pattern & 2U) != 0)
                for (const double step : {4.0, 16.0, 64.0}) at.push_back(1.0 - 1.0 / (step * pieces));
            at.push_back(double(k) / pieces);
            if (k == 0 && (pattern & 1U) != 0)
                for (const double step : {64.0, 16.0, 4.0}) at.push_back(1.0 / (step * pieces));
        }
    }
    cvs_.assign(1, 0);
    for (size_t c = 0; c < counts_.size(); ++c) {
        uint64_t count = counts_[c];
        if (!keeps_vertices_) {
            count = std::min<uint64_t>(count, 1);
            for (uint32_t cubic = 0; cubic < kind_.segments(counts_[c]); ++cubic)
                count += patterns_[pattern_of(c, cubic)].size() - 1;
        }
        cvs_.push_back(cvs_.back() + count);
    }
}

bool UsdaCvs::mark_corners(std::span<const double> points) {
    if (kind_.basis == UsdaCurveBasis::linear) return false;
    constexpr double near = 1.0 / 64.0, min_angle = 0.1;
    corners_.resize(joint_count(), 0);
    for (size_t c = 0; c < curve_count(); ++c)
        for (uint32_t cubic = 1; cubic < kind_.segments(counts_[c]); ++cubic) {
            const auto point = [&](const std::array<Vec3d, 4>& p, double t) {
                return weighted(p, weights_at(kind_.basis, t).value);
            };
            const std::array<Vec3d, 4> before = cubic_of(c, cubic - 1, points),
                                       after = cubic_of(c, cubic, points);
            const Vec3d in = point(before, 1.0) - point(before, 1.0 - near),
                        out = point(after, near) - point(after, 0.0);
            if (in.cross(out).norm() > min_angle * in.dot(out)) corners_[joints_[c] + cubic] = 1;
        }
    return std::ranges::any_of(corners_, [](char corner) { return corner != 0; });
}

std::vector<uint32_t> UsdaCvs::cv_counts() const {
    std::vector<uint32_t> counts(curve_count());
    for (size_t c = 0; c < counts.size(); ++c) counts[c] = uint32_t(cvs_[c + 1] - cvs_[c]);
    return counts;
}

// Visits the CVs of a curve with segments.
template <typename Visit>
void UsdaCvs::for_cvs(size_t curve, Visit&& visit) const {
    const uint32_t cubics = kind_.segments(counts_[curve]);
    uint64_t cv = cvs_[curve];
    for (uint32_t cubic = 0; cubic < cubics; ++cubic) {
        const uint32_t pattern = pattern_of(curve, cubic),
                       steps = uint32_t(patterns_[pattern].size()) - (cubic + 1 < cubics ? 1 : 0);
        for (uint32_t step = 0; step < steps; ++step) visit(At{cv++, cubic, pattern, step});
    }
}

// Vertex i of a cubic as a sum of the file's vertices: add(index over all curves, factor).
template <typename Add>
void UsdaCvs::for_vertex(size_t curve, uint32_t cubic, uint32_t i, Add&& add) const {
    const uint64_t first = vertices_[curve], count = counts_[curve];
    const uint64_t at = uint64_t(cubic) * (kind_.basis == UsdaCurveBasis::bezier ? 3 : 1) + i;
    if (kind_.wrap == UsdaCurveWrap::periodic) return add(first + at % count, 1.0);
    if (kind_.wrap != UsdaCurveWrap::pinned || kind_.basis == UsdaCurveBasis::bezier)
        return add(first + at, 1.0);
    if (at > 0 && at <= count)
        return add(first + at - 1, 1.0); // usda_curves.cpp: one vertex more at each end
    const uint64_t end = at == 0 ? 0 : count - 1, next = at == 0 ? 1 : count - 2;
    add(first + end, 2.0);
    add(first + next, -1.0);
}

std::array<Vec3d, 4> UsdaCvs::cubic_of(size_t curve, uint32_t cubic, std::span<const double> points) const {
    std::array<Vec3d, 4> vertices;
    for (uint32_t i = 0; i < 4; ++i) {
        vertices[i].setZero();
        for_vertex(curve, cubic, i, [&](uint64_t at, double factor) {
            vertices[i] += factor * Vec3d(points.data() + 3 * at);
        });
    }
    return vertices;
}

std::vector<double> UsdaCvs::of_vertices(std::span<const double> values, size_t components,
                                         bool discrete) const {
    if (keeps_vertices_) return {values.begin(), values.end()};
    std::array<std::vector<std::array<double, 4>>, 4> weights; // [pattern][step]
    for (size_t pattern = 0; pattern < patterns_.size(); ++pattern)
        for (const double t : patterns_[pattern]) {
            std::array<double, 4>& w = weights[pattern].emplace_back();
            w = kind_.basis == UsdaCurveBasis::linear
                    ? std::array{t == 0.0 ? 1.0 : 0.0, t == 0.0 ? 0.0 : 1.0, 0.0, 0.0}
                    : weights_at(kind_.basis, t).value;
            if (!discrete) continue;
            const auto most = std::ranges::max_element(w);
            for (auto i = w.begin(); i != w.end(); ++i) *i = i == most ? 1.0 : 0.0;
        }
    std::vector<double> out(cv_count() * components);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, curve_count(), curves_a_task), [&](const auto& range) {
        for (size_t c = range.begin(); c < range.end(); ++c) {
            if (counts_[c] == 1)
                std::copy_n(values.data() + vertices_[c] * components, components,
                            out.data() + cvs_[c] * components);
            for_cvs(c, [&](const At& at) {
                const std::array<double, 4>& w = weights[at.pattern][at.step];
                double* to = out.data() + at.cv * components;
                for (uint32_t i = 0; i < 4; ++i) {
                    if (w[i] == 0.0) continue; // linear curves have no such vertex
                    for_vertex(c, at.cubic, i, [&](uint64_t vertex, double factor) {
                        const double* from = values.data() + vertex * components;
                        for (size_t k = 0; k < components; ++k) to[k] += factor * w[i] * from[k];
                    });
                }
            });
        }
    });
    return out;
}

std::vector<double> UsdaCvs::of_joints(std::span<const double> values, size_t components,
                                       bool discrete) const {
    if (keeps_vertices_) return {values.begin(), values.end()};
    std::vector<double> out(cv_count() * components);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, curve_count(), curves_a_task), [&](const auto& range) {
        for (size_t c = range.begin(); c < range.end(); ++c) {
            const uint64_t joints = joints_[c + 1] - joints_[c];
            if (counts_[c] == 1 && joints > 0)
                std::copy_n(values.data() + joints_[c] * components, components,
                            out.data() + cvs_[c] * components);
            for_cvs(c, [&](const At& at) {
                const double exact = patterns_[at.pattern][at.step], t = discrete ? std::round(exact) : exact;
                const double* a = values.data() + (joints_[c] + at.cubic) * components;
                const double* b = values.data() + (joints_[c] + (at.cubic + 1) % joints) * components;
                double* to = out.data() + at.cv * components;
                for (size_t k = 0; k < components; ++k)
                    to[k] = t == 0.0 ? a[k] : t == 1.0 ? b[k] : a[k] + t * (b[k] - a[k]);
            });
        }
    });
    return out;
}

std::vector<double> UsdaCvs::of_curves(std::span<const double> values, size_t components) const {
    std::vector<double> out(cv_count() * components);
    for (size_t c = 0; c < curve_count(); ++c)
        for (uint64_t cv = cvs_[c]; cv < cvs_[c + 1]; ++cv)
            std::copy_n(values.data() + c * components, components, out.data() + cv * components);
    return out;
}

UsdaCvs::Deviation UsdaCvs::deviation_of(size_t curve, std::span<const double> points,
                                         std::span<const double> cvs) const {
    constexpr int tests = 8;
    const auto at = [](std::span<const double> from, uint64_t i) { return Vec3d(from.data() + 3 * i); };
    if (cvs_[curve + 1] < cvs_[curve] + 2) return {};
    const uint64_t first = cvs_[curve], last = cvs_[curve + 1] - 1;
    const auto cv = [&](int64_t i) -> Vec3d { // 0: the curve's first; phantom ones at both ends
        if (i < 0) return 2.0 * at(cvs, first) - at(cvs, first + 1);
        if (first + uint64_t(i) > last) return 2.0 * at(cvs, last) - at(cvs, last - 1);
        return at(cvs, first + uint64_t(i));
    };
    double length = 0.0;
    for (uint64_t i = first; i < last; ++i) length += (at(cvs, i + 1) - at(cvs, i)).norm();
    Deviation greatest;
    for_cvs(curve, [&](const At& begin) { // each segment from this CV to the next
        if (begin.cv == last) return;
        const std::array<Vec3d, 4> of_file = cubic_of(curve, begin.cubic, points);
        const double t0 = patterns_[begin.pattern][begin.step], t1 = patterns_[begin.pattern][begin.step + 1];
        std::array<Vec3d, 4> drawn;
        for (uint32_t i = 0; i < 4; ++i) drawn[i] = cv(int64_t(begin.cv - first) + int64_t(i) - 1);
        for (int k = 1; k < tests; ++k) {
            const double u = double(k) / tests;
            const Vec3d point = weighted(drawn, cubic_basis(MARRAM_CATMULL_ROM, u).value);
            greatest.distance =
                std::max(greatest.distance, distance_near(point, of_file, kind_.basis, t0 + u * (t1 - t0),
                                                          std::max(1e-9 * length, greatest.distance)));
        }
    });
    greatest.share = length > 0.0 ? greatest.distance / length : 0.0;
    return greatest;
}

UsdaCvs::Deviation UsdaCvs::deviation(std::span<const double> points, std::span<const double> cvs) const {
    if (keeps_vertices_ || kind_.basis == UsdaCurveBasis::linear) return {};
    const auto greater = [](Deviation a, Deviation b) {
        return Deviation{std::max(a.distance, b.distance), std::max(a.share, b.share)};
    };
    return tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, curve_count(), curves_a_task), Deviation{},
        [&](const auto& range, Deviation part) {
            for (size_t c = range.begin(); c < range.end(); ++c)
                part = greater(part, deviation_of(c, points, cvs));
            return part;
        },
        greater);
}

} // namespace marram
