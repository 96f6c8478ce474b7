// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/contact.h"

#include "core/math/hash.h"
#include "tests/oracle/sweep.h"

#include <algorithm>

namespace marram::oracle {
namespace {

using Reached = std::vector<Triangle>; // triangles in reach of any direction, relative to the pivot

Reached in_reach(const Vec3d& pivot, double radius, const TriangleSet& set) {
    Reached result;
    for (int i : set.within(pivot, pivot, radius * (1.0 + 1e-9))) { // the sweep's rounding
        const Triangle& t = set.triangles()[size_t(i)];
        result.push_back({t.a - pivot, t.b - pivot, t.c - pivot});
    }
    return result;
}

Reached not_proven_free(const Sweep& sweep, double begin, double end, const Reached& triangles) {
    Reached kept;
    for (const Triangle& t : triangles)
        if (!proven_free(sweep, 0.5 * (begin + end), 0.5 * (end - begin), t)) kept.push_back(t);
    return kept;
}

std::optional<double> contact_between(const Sweep& sweep, double begin, double end,
                                      const Reached& triangles) {
    const Reached kept = not_proven_free(sweep, begin, end, triangles);
    if (kept.empty()) return std::nullopt;
    if (end - begin <= angle_tolerance) return begin;
    const double middle = 0.5 * (begin + end);
    const auto before = contact_between(sweep, begin, middle, kept);
    return before ? before : contact_between(sweep, middle, end, kept);
}

bool blocked(const Sweep& sweep, double begin, double end, const Reached& triangles) {
    return std::any_of(triangles.begin(), triangles.end(), [&](const Triangle& t) {
        return !is_free(sweep, begin, t) && !is_free(sweep, end, t);
    });
}

std::optional<double> free_between(const Sweep& sweep, double begin, double end, const Reached& triangles) {
    const Reached kept = not_proven_free(sweep, begin, end, triangles);
    if (kept.empty()) return begin;
    if (end - begin <= angle_tolerance || blocked(sweep, begin, end, kept)) return std::nullopt;
    const double middle = 0.5 * (begin + end);
    const auto before = free_between(sweep, begin, middle, kept);
    return before ? before : free_between(sweep, middle, end, kept);
}

// Runs `search` over [0, whole] in parts of at most a quarter turn, which the bounds of sweep.h ask for.
template <typename Search>
std::optional<double> in_parts(double whole, Search&& search) {
    const int parts = std::max(1, int(std::ceil(whole / (0.5 * pi))));
    for (int i = 0; i < parts; ++i)
        if (const auto found = search(whole * i / parts, whole * (i + 1) / parts)) return found;
    return std::nullopt;
}

std::optional<double> contact_angle(Sweep sweep, double clearance, double whole, const Reached& triangles) {
    sweep.clearance = clearance;
    for (const Triangle& t : triangles)
        if (!is_free(sweep, 0.0, t)) return 0.0;
    return in_parts(whole,
                    [&](double begin, double end) { return contact_between(sweep, begin, end, triangles); });
}

// Length of the segment up to its first hit.
double way_before_hit(const Vec3d& pivot, const Vec3d& u, double length, const TriangleSet& set) {
    const std::vector<Hit> hits = set.crossings(pivot, pivot + length * u);
    return hits.empty() ? TriangleSet::no_limit : hits.front().crossing.parameter * length;
}

// Directions drawn around `best` in ever narrower caps, going to whichever comes further.
std::optional<Vec3d> refined(const Vec3d& pivot, Vec3d best, double way, double length, double cap,
                             const TriangleSet& set, uint64_t seed) {
    constexpr int rounds = 12, tries = 24; // the cap narrows to 1/4096 of the spacing
    for (int round = 0; round < rounds; ++round, cap *= 0.5) {
        Vec3d x, y;
        orthonormal_basis(best, x, y);
        const Vec3d centre = best;
        for (int i = 0; i < tries; ++i) {
            const uint64_t h = hash(seed, uint64_t(round * tries + i));
            const double angle = 2.0 * pi * unit_double(h), radius = cap * std::sqrt(unit_double(hash(h, 1)));
            const Vec3d u = (centre + radius * (x * std::cos(angle) + y * std::sin(angle))).normalized();
            const double found = way_before_hit(pivot, u, length, set);
            if (found == TriangleSet::no_limit) return u;
            if (found > way) way = found, best = u;
        }
    }
    return std::nullopt;
}

} // namespace

bool is_free(const Vec3d& pivot, const Vec3d& u, double length, double c, const TriangleSet& set) {
    const Sweep sweep{u, Vec3d::Zero(), length, c};
    const Reached triangles = in_reach(pivot, length + c, set);
    return std::all_of(triangles.begin(), triangles.end(),
                       [&](const Triangle& t) { return is_free(sweep, 0.0, t); });
}

Contact first_contact(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double whole, double length,
                      double c, const TriangleSet& set, double margin) {
    const Sweep sweep{u, axis.cross(u), length, c};
    const Reached triangles = in_reach(pivot, length + c + margin, set);
    Contact contact;
    const auto found = contact_angle(sweep, c, whole, triangles);
    contact.touches = found.has_value();
    contact.angle = contact.earliest = contact.latest = found.value_or(whole);
    if (margin > 0.0) {
        contact.earliest = contact_angle(sweep, c + margin, whole, triangles).value_or(whole);
        contact.latest = contact_angle(sweep, std::max(c - margin, 0.0), whole, triangles).value_or(whole);
    }
    return contact;
}

std::optional<double> first_free(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double length,
                                 double c, const TriangleSet& set) {
    const Sweep sweep{u, axis.cross(u), length, c};
    const Reached triangles = in_reach(pivot, length + c, set);
    return in_parts(2.0 * pi,
                    [&](double begin, double end) { return free_between(sweep, begin, end, triangles); });
}

std::optional<Vec3d> any_free_direction(const Vec3d& pivot, double length, const TriangleSet& set,
                                        int samples) {
    std::vector<std::pair<double, Vec3d>> ways;
    const double golden_angle = pi * (3.0 - std::sqrt(5.0));
    for (int i = 0; i < samples; ++i) { // a Fibonacci spiral over the sphere
        const double z = 1.0 - (2.0 * i + 1.0) / samples, r = std::sqrt(1.0 - z * z);
        const Vec3d u(r * std::cos(golden_angle * i), r * std::sin(golden_angle * i), z);
        const double way = way_before_hit(pivot, u, length, set);
        if (way == TriangleSet::no_limit) return u;
        ways.emplace_back(way, u);
    }
    const size_t promising = std::min<size_t>(64, ways.size());
    std::partial_sort(ways.begin(), ways.begin() + std::ptrdiff_t(promising), ways.end(),
                      [](const auto& a, const auto& b) { return a.first > b.first; });
    const double spacing = 2.0 / std::sqrt(samples / pi);
    for (size_t i = 0; i < promising; ++i)
        if (const auto found = refined(pivot, ways[i].second, ways[i].first, length, spacing, set, i))
            return found;
    return std::nullopt;
}

} // namespace marram::oracle
