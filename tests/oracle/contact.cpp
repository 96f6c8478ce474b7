// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/contact.h"

#include "core/math/hash.h"
#include "tests/oracle/sweep.h"

#include <algorithm>
#include <stdexcept>

namespace marram::oracle {
namespace {

using ReachableTriangles =
    std::vector<Triangle>; // triangles in reach of any direction, relative to the pivot

ReachableTriangles in_reach(const Vec3d& pivot, double radius, const TriangleSet& set) {
    ReachableTriangles result;
    for (int i : set.within(pivot, pivot, radius * (1.0 + 1e-9))) { // allows for the sweep's rounding
        const Triangle& t = set.triangles()[size_t(i)];
        result.push_back({t.a - pivot, t.b - pivot, t.c - pivot});
    }
    return result;
}

ReachableTriangles not_proven_free(const Sweep& sweep, double begin, double end,
                                   const ReachableTriangles& triangles) {
    ReachableTriangles kept;
    for (const Triangle& t : triangles)
        if (!proven_free(sweep, 0.5 * (begin + end), 0.5 * (end - begin), t)) kept.push_back(t);
    return kept;
}

// Intervals examined so far in one search.
struct SearchBudget {
    int intervals = 0;

    void spend() {
        constexpr int most = 1000000;
        if (++intervals > most)
            throw std::runtime_error("oracle: a turn is not decided after a million intervals");
    }
};

std::optional<double> contact_between(const Sweep& sweep, double begin, double end,
                                      const ReachableTriangles& triangles, SearchBudget& effort) {
    effort.spend();
    const ReachableTriangles kept = not_proven_free(sweep, begin, end, triangles);
    if (kept.empty()) return std::nullopt;
    if (end - begin <= angle_tolerance) return begin;
    const double middle = 0.5 * (begin + end);
    const auto before = contact_between(sweep, begin, middle, kept, effort);
    return before ? before : contact_between(sweep, middle, end, kept, effort);
}

bool blocked(const Sweep& sweep, double begin, double end, const ReachableTriangles& triangles) {
    return std::any_of(triangles.begin(), triangles.end(), [&](const Triangle& t) {
        return !is_free(sweep, begin, t) && !is_free(sweep, end, t);
    });
}

std::optional<double> free_between(const Sweep& sweep, double begin, double end,
                                   const ReachableTriangles& triangles, SearchBudget& effort) {
    effort.spend();
    const ReachableTriangles kept = not_proven_free(sweep, begin, end, triangles);
    if (kept.empty()) return begin;
    if (end - begin <= angle_tolerance || blocked(sweep, begin, end, kept)) return std::nullopt;
    const double middle = 0.5 * (begin + end);
    const auto before = free_between(sweep, begin, middle, kept, effort);
    return before ? before : free_between(sweep, middle, end, kept, effort);
}

// Runs `search` over [0, whole] in parts of at most a quarter turn, as the bounds of sweep.h require.
template <typename Search>
std::optional<double> in_parts(double whole, Search&& search) {
    const int parts = std::max(1, int(std::ceil(whole / (0.5 * pi))));
    for (int i = 0; i < parts; ++i)
        if (const auto found = search(whole * i / parts, whole * (i + 1) / parts)) return found;
    return std::nullopt;
}

std::optional<double> contact_angle(Sweep sweep, double clearance, double whole,
                                    const ReachableTriangles& triangles) {
    sweep.clearance = clearance;
    for (const Triangle& t : triangles)
        if (!is_free(sweep, 0.0, t)) return 0.0;
    SearchBudget effort;
    return in_parts(whole, [&](double begin, double end) {
        return contact_between(sweep, begin, end, triangles, effort);
    });
}

// How close a direction is to being free; 0 means free. In [-1, 0) it crosses nothing, and the kept fraction
// of the clearance ranks it; below -1 it crosses, and the fraction of the segment before the first crossing
// ranks it.
double direction_score(const Vec3d& pivot, const Vec3d& u, double length, double c, const TriangleSet& set) {
    const Vec3d end = pivot + length * u;
    const std::vector<Hit> hits = set.crossings(pivot, end);
    if (!hits.empty()) return hits.front().crossing.parameter - 2.0;
    const double distance = c > 0.0 ? set.nearest(pivot, end, c).closest.distance : 0.0;
    return distance >= c ? 0.0 : distance / c - 1.0;
}

struct Ranked {
    double direction_score;
    Vec3d u;
};

// Tries random directions around the best one so far, in ever narrower caps.
std::optional<Vec3d> refined(const Vec3d& pivot, Ranked best, double length, double c, double cap,
                             const TriangleSet& set, uint64_t seed) {
    constexpr int rounds = 12, tries = 24; // the cap narrows to 1/4096 of the spacing
    for (int round = 0; round < rounds; ++round, cap *= 0.5) {
        Vec3d x, y;
        orthonormal_basis(best.u, x, y);
        const Vec3d centre = best.u;
        for (int i = 0; i < tries; ++i) {
            const uint64_t h = hash(seed, uint64_t(round * tries + i));
            const double angle = 2.0 * pi * unit_double(h), radius = cap * std::sqrt(unit_double(hash(h, 1)));
            const Vec3d u = (centre + radius * (x * std::cos(angle) + y * std::sin(angle))).normalized();
            const double found = direction_score(pivot, u, length, c, set);
            if (found >= 0.0) return u;
            if (found > best.direction_score) best = {found, u};
        }
    }
    return std::nullopt;
}

} // namespace

bool is_free(const Vec3d& pivot, const Vec3d& u, double length, double c, const TriangleSet& set) {
    const Sweep sweep{u, Vec3d::Zero(), length, c};
    const ReachableTriangles triangles = in_reach(pivot, length + c, set);
    return std::all_of(triangles.begin(), triangles.end(),
                       [&](const Triangle& t) { return is_free(sweep, 0.0, t); });
}

Contact first_contact(const Vec3d& pivot, const Vec3d& u, const Vec3d& axis, double whole, double length,
                      double c, const TriangleSet& set, double margin) {
    const Sweep sweep{u, axis.cross(u), length, c};
    const ReachableTriangles triangles = in_reach(pivot, length + c + margin, set);
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
    const ReachableTriangles triangles = in_reach(pivot, length + c, set);
    SearchBudget effort;
    return in_parts(2.0 * pi, [&](double begin, double end) {
        return free_between(sweep, begin, end, triangles, effort);
    });
}

std::optional<Vec3d> any_free_direction(const Vec3d& pivot, double length, double c, const TriangleSet& set,
                                        int samples) {
    if (!is_free(pivot, Vec3d::UnitX(), 0.0, c, set)) return std::nullopt;
    std::vector<Ranked> ranked;
    const double golden_angle = pi * (3.0 - std::sqrt(5.0));
    for (int i = 0; i < samples; ++i) { // a Fibonacci spiral over the sphere
        const double z = 1.0 - (2.0 * i + 1.0) / samples, r = std::sqrt(1.0 - z * z);
        const Vec3d u(r * std::cos(golden_angle * i), r * std::sin(golden_angle * i), z);
        ranked.push_back({direction_score(pivot, u, length, c, set), u});
        if (ranked.back().direction_score >= 0.0) return u;
    }
    const size_t promising = std::min<size_t>(64, ranked.size());
    std::partial_sort(ranked.begin(), ranked.begin() + std::ptrdiff_t(promising), ranked.end(),
                      [](const Ranked& a, const Ranked& b) { return a.direction_score > b.direction_score; });
    const double spacing = 2.0 / std::sqrt(samples / pi);
    for (size_t i = 0; i < promising; ++i)
        if (const auto found = refined(pivot, ranked[i], length, c, spacing, set, i)) return found;
    return std::nullopt;
}

} // namespace marram::oracle
