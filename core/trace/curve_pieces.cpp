// SPDX-License-Identifier: Apache-2.0
#include "core/trace/curve_pieces.h"

#include "core/geometry/cubic.h"

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

using Points4 = Eigen::Map<const Eigen::Matrix<float, 4, 4>>;

Vec4d weigh(const Points4& control, const std::array<double, 4>& weights) {
    return control.cast<double>() * Eigen::Map<const Vec4d>(weights.data());
}

} // namespace

double ChordLimit::squared_at(const Vec3d& point) const {
    const double pixels = 0.25 * pixel_angle;
    return std::min(0.25 * tolerance * tolerance, pixels * pixels * (point - camera).squaredNorm());
}

void add_chord_errors(const CurveVertices& curves, const ChordLimit& limit, ChordErrors& errors) {
    const std::array<double, 4> begin = cubic_basis(curves.basis, 0.0).second,
                                end = cubic_basis(curves.basis, 1.0).second;
    std::array<double, most_pieces> squares{}; // of 24 n^2 times the errors over the limit
    for (size_t curve = 0; curve < curves.curves; ++curve)
        for (uint32_t segment = 0; segment + 1 < curves.cvs; ++segment) {
            const Points4 control(curves.vertices + 4 * (curve * (curves.cvs + 2) + segment));
            const Vec4d a = weigh(control, begin), b = weigh(control, end);
            const double allowed = std::min(limit.squared_at(control.col(1).head<3>().cast<double>()),
                                            limit.squared_at(control.col(2).head<3>().cast<double>()));
            const double per_allowed = 1.0 / allowed;
            for (uint32_t i = 0; i < most_pieces; ++i) {
                const Vec4d step = (b - a) * (1.0 / (i + 1));
                const double off = std::max((3.0 * a + step).squaredNorm(), (3.0 * b - step).squaredNorm());
                if (off > 0.0) squares[i] = std::max(squares[i], off * per_allowed);
            }
        }
    for (uint32_t i = 0; i < most_pieces; ++i)
        errors[i] = std::max(errors[i], std::sqrt(squares[i]) / (24.0 * (i + 1) * (i + 1)));
}

uint32_t max_useful_pieces(MarramShape shape, size_t keys) {
    if (keys > 2) return 1;
    return (shape == MARRAM_ROUND ? 4U : 3U) / uint32_t(keys);
}

ChordErrors max_errors(const ChordErrors& a, const ChordErrors& b) {
    ChordErrors most;
    for (uint32_t i = 0; i < most_pieces; ++i) most[i] = std::max(a[i], b[i]);
    return most;
}

uint32_t min_pieces(const ChordErrors& errors, uint32_t most) {
    for (uint32_t i = 0; i < most; ++i)
        if (errors[i] <= 1.0) return i + 1;
    return 0;
}

Chord chord_of(const Eigen::Matrix4d& segment, MarramBasis basis, uint32_t piece, uint32_t pieces) {
    const double n = pieces;
    const std::array<double, 4> begin = cubic_basis(basis, piece / n).value,
                                end = cubic_basis(basis, (piece + 1) / n).value;
    return {segment * Vec4d::Map(begin.data()), segment * Vec4d::Map(end.data())};
}

double end_share(const Chord& at_first_key, bool tip) {
    const double length = (at_first_key.end - at_first_key.begin).head<3>().norm();
    const double radius = std::abs((tip ? at_first_key.end : at_first_key.begin)[3]);
    return radius < 0.5 * length ? radius / length : 0.5; // a strand of one piece may shrink to a disc
}

void write_pieces(const CurveVertices& curves, const float* first_key, uint32_t pieces, float* out) {
    for (size_t curve = 0; curve < curves.curves; ++curve)
        for (uint32_t segment = 0; segment + 1 < curves.cvs; ++segment) {
            const size_t first = 4 * (curve * (curves.cvs + 2) + segment);
            const Eigen::Matrix4d control = Points4(curves.vertices + first).cast<double>();
            const auto share = [&](uint32_t piece, bool tip) {
                return end_share(
                    chord_of(Points4(first_key + first).cast<double>(), curves.basis, piece, pieces), tip);
            };
            for (uint32_t piece = 0; piece < pieces; ++piece, out += 4) {
                const Chord chord = chord_of(control, curves.basis, piece, pieces);
                const Vec4d along = chord.end - chord.begin;
                const bool root = segment == 0 && piece == 0,
                           tip = segment + 2 == curves.cvs && piece + 1 == pieces;
                Vec4f::Map(out) = (chord.begin + (root ? share(piece, false) : 0.0) * along).cast<float>();
                if (!tip) continue;
                Vec4f::Map(out + 4) = (chord.end - share(piece, true) * along).cast<float>();
                out += 4;
            }
        }
}

} // namespace marram
