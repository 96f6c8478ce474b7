// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/shield.h"

#include <algorithm>

namespace marram::oracle {
namespace {

double radical_inverse(int i) {
    double value = 0.0;
    for (double digit = 0.5; i > 0; i /= 2, digit *= 0.5) value += i % 2 * digit;
    return value;
}

} // namespace

Shielding shield_curve(const std::vector<Vec3d>& cvs, const Vec3d& wind, double offset, double margin,
                       const TriangleSet& set) {
    Shielding result;
    const double reach = shield_grazing * offset;
    for (const Vec3d& p : cvs) {
        const Vec3d begin = p - wind * offset, end = p - wind * (offset * margin);
        bool hit = false, grazing = false;
        for (int i : set.within(begin, end, reach)) {
            const Crossing c = crossing(begin, end, set.triangles()[size_t(i)]);
            hit = hit || c.crosses;
            grazing = grazing || c.margin <= reach;
        }
        result.hit.push_back(hit);
        result.grazing.push_back(grazing);
        result.alpha += hit ? 1.0 / double(cvs.size()) : 0.0;
    }
    return result;
}

Shelter shelter_from(const Vec3d& p, const Vec3d& from, double offset, double margin, const TriangleSet& set,
                     const Fade& fade) {
    Shelter result;
    const double reach = shield_grazing * offset, length = offset * (1.0 - margin);
    const Vec3d begin = p + from * (offset * margin), end = p + from * offset;
    double nearest = TriangleSet::no_limit;
    for (int i : set.within(begin, end, reach)) {
        const Crossing c = crossing(begin, end, set.triangles()[size_t(i)]);
        result.grazing = result.grazing || c.margin <= reach;
        const double d = offset * margin + c.parameter * length;
        if (!c.crosses || d >= nearest) continue;
        nearest = d;
        result.value = fade ? std::clamp(1.0 - d / fade(i), 0.0, 1.0) : 1.0;
    }
    return result;
}

double cone_shelter(const Vec3d& p, const Vec3d& normal, const Vec3d& wind, double spread, int n,
                    double offset, double margin, const TriangleSet& set, const Fade& fade) {
    const Vec3d axis = -wind;
    const Vec3d u = axis.unitOrthogonal(), v = axis.cross(u);
    const double lowest = std::min(axis.dot(normal), 0.0);
    double sum = 0.0;
    int directions = 0;
    for (int i = 0; i < n; ++i) {
        const double z = 1.0 - (1.0 - std::cos(spread)) * (i + 0.5) / n, r = std::sqrt(1.0 - z * z);
        const double turn = 2.0 * pi * radical_inverse(i);
        const Vec3d from = axis * z + (u * std::cos(turn) + v * std::sin(turn)) * r;
        if (from.dot(normal) < lowest) continue;
        sum += shelter_from(p, from, offset, margin, set, fade).value;
        ++directions;
    }
    if (directions == 0) return shelter_from(p, axis, offset, margin, set, fade).value;
    return sum / directions;
}

double shield_envelope(double shield, double alpha) { return std::clamp(1.0 - shield * alpha, 0.0, 1.0); }

} // namespace marram::oracle
