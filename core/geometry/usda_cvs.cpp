// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/usda_cvs.h"

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

UsdaCvs::UsdaCvs(UsdaCurveKind kind, std::vector<uint32_t> counts) : kind_(kind), counts_(std::move(counts)) {
    const bool periodic = kind.wrap == UsdaCurveWrap::periodic,
               is_linear = kind.basis == UsdaCurveBasis::linear;
    keeps_vertices_ =
        is_linear ? !periodic : kind.wrap == UsdaCurveWrap::pinned && kind.basis != UsdaCurveBasis::bezier;
    vertices_.assign(1, 0);
    joints_.assign(1, 0);
    for (const uint32_t count : counts_) {
        vertices_.push_back(vertices_.back() + count);
        joints_.push_back(joints_.back() + kind_.segments(count) + (periodic ? 0 : 1));
    }
    cut(1);
}

MarramBasis UsdaCvs::basis() const {
    if (kind_.basis == UsdaCurveBasis::linear) return MARRAM_LINEAR;
    return keeps_vertices_ && kind_.basis == UsdaCurveBasis::bspline ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM;
}

void UsdaCvs::cut(uint32_t pieces) {
    pieces_ = pieces;
    cvs_.assign(1, 0);
    for (const uint32_t count : counts_)
        cvs_.push_back(cvs_.back() +
                       (keeps_vertices_ ? count : uint64_t(kind_.segments(count)) * pieces_ + 1));
}

std::vector<uint32_t> UsdaCvs::cv_counts() const {
    std::vector<uint32_t> counts(curve_count());
    for (size_t c = 0; c < counts.size(); ++c) counts[c] = uint32_t(cvs_[c + 1] - cvs_[c]);
    return counts;
}

uint64_t UsdaCvs::vertex_of(size_t curve, uint32_t cubic, uint32_t i) const {
    const uint64_t at = uint64_t(cubic) * (kind_.basis == UsdaCurveBasis::bezier ? 3 : 1) + i;
    return vertices_[curve] + (kind_.wrap == UsdaCurveWrap::periodic ? at % counts_[curve] : at);
}

std::vector<double> UsdaCvs::of_vertices(std::span<const double> values, size_t components,
                                         bool discrete) const {
    if (keeps_vertices_) return {values.begin(), values.end()};
    std::vector<std::array<double, 4>> weights(pieces_ + 1);
    for (uint32_t k = 0; k <= pieces_; ++k) {
        if (kind_.basis == UsdaCurveBasis::linear)
            weights[k] = {k == 0 ? 1.0 : 0.0, k == 0 ? 0.0 : 1.0, 0.0, 0.0};
        else
            weights[k] = weights_at(kind_.basis, double(k) / pieces_).value;
        if (!discrete) continue;
        const auto most = std::ranges::max_element(weights[k]);
        for (auto w = weights[k].begin(); w != weights[k].end(); ++w) *w = w == most ? 1.0 : 0.0;
    }
    std::vector<double> out(cv_count() * components);
    tbb::parallel_for(tbb::blocked_range<size_t>(0, curve_count(), curves_a_task), [&](const auto& range) {
        for (size_t c = range.begin(); c < range.end(); ++c) {
            const uint32_t cubics = kind_.segments(counts_[c]);
            for (uint64_t j = 0; j < cvs_[c + 1] - cvs_[c]; ++j) {
                const auto cubic = uint32_t(std::min<uint64_t>(j / pieces_, cubics - 1));
                const std::array<double, 4>& w = weights[size_t(j - uint64_t(cubic) * pieces_)];
                double* to = out.data() + (cvs_[c] + j) * components;
                for (uint32_t i = 0; i < 4; ++i) {
                    if (w[i] == 0.0) continue; // linear curves have no such vertex
                    const double* from = values.data() + vertex_of(c, cubic, i) * components;
                    for (size_t k = 0; k < components; ++k) to[k] += w[i] * from[k];
                }
            }
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
            const uint64_t joints = joints_[c + 1] - joints_[c], cubics = kind_.segments(counts_[c]);
            for (uint64_t j = 0; j < cvs_[c + 1] - cvs_[c]; ++j) {
                const uint64_t cubic = std::min<uint64_t>(j / pieces_, cubics - 1);
                const double exact = double(j - cubic * pieces_) / pieces_,
                             t = discrete ? std::round(exact) : exact;
                const double* a = values.data() + (joints_[c] + cubic) * components;
                const double* b = values.data() + (joints_[c] + (cubic + 1) % joints) * components;
                double* to = out.data() + (cvs_[c] + j) * components;
                for (size_t k = 0; k < components; ++k)
                    to[k] = t == 0.0 ? a[k] : t == 1.0 ? b[k] : a[k] + t * (b[k] - a[k]);
            }
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
    const uint64_t first = cvs_[curve], last = cvs_[curve + 1] - 1;
    const auto cv = [&](int64_t i) -> Vec3d { // 0: the curve's first; phantom ones at both ends
        if (i < 0) return 2.0 * at(cvs, first) - at(cvs, first + 1);
        if (first + uint64_t(i) > last) return 2.0 * at(cvs, last) - at(cvs, last - 1);
        return at(cvs, first + uint64_t(i));
    };
    double length = 0.0;
    for (uint64_t i = first; i < last; ++i) length += (at(cvs, i + 1) - at(cvs, i)).norm();
    Deviation greatest;
    for (uint64_t j = 0; j < last - first; ++j) {
        const auto cubic = uint32_t(j / pieces_);
        std::array<Vec3d, 4> of_file, drawn;
        for (uint32_t i = 0; i < 4; ++i) {
            of_file[i] = at(points, vertex_of(curve, cubic, i));
            drawn[i] = cv(int64_t(j) + int64_t(i) - 1);
        }
        for (int k = 1; k < tests; ++k) {
            const double u = double(k) / tests;
            const Vec3d point = weighted(drawn, cubic_basis(MARRAM_CATMULL_ROM, u).value);
            greatest.distance =
                std::max(greatest.distance,
                         distance_near(point, of_file, kind_.basis, (double(j % pieces_) + u) / pieces_,
                                       std::max(1e-9 * length, greatest.distance)));
        }
    }
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
