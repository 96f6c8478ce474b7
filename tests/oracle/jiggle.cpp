// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/jiggle.h"

#include <algorithm>
#include <array>

namespace marram::oracle {
namespace {

struct State {
    Vec3d x, velocity;
};

using Cubic = std::array<Vec3d, 4>; // sum over n of cubic[n] t^n

Vec3d value(const Cubic& g, double t) { return g[0] + t * (g[1] + t * (g[2] + t * g[3])); }

// Advances by `time` with the target g, t seconds later. The three components are independent.
void advance(State& state, double time, const Cubic& g, double omega, double zeta) {
    constexpr double longest = 0.25; // in 1 / (omega max(1, 2 zeta)), see jiggle.h
    constexpr int terms = 16;
    const int steps = std::max(1, int(std::ceil(time * omega * std::max(1.0, 2.0 * zeta) / longest)));
    const double h = time / steps;
    for (int step = 0; step < steps; ++step) {
        Vec3d derivative[terms + 2] = {state.x, state.velocity};
        const double t = h * step;
        const Vec3d target[] = {value(g, t), g[1] + t * (2.0 * g[2] + 3.0 * t * g[3]),
                                2.0 * g[2] + 6.0 * t * g[3], 6.0 * g[3]}; // and its derivatives
        for (int n = 0; n < terms; ++n)
            derivative[n + 2] = -2.0 * zeta * omega * derivative[n + 1] - omega * omega * derivative[n] +
                                omega * omega * (n < 4 ? target[n] : Vec3d::Zero());
        state = {Vec3d::Zero(), Vec3d::Zero()};
        for (int n = terms; n >= 0; --n) { // Horner's scheme
            state.x = derivative[n] + state.x * (h / (n + 1));
            state.velocity = derivative[n + 1] + state.velocity * (h / (n + 1));
        }
    }
}

// The target of a CV from knot i on.
Cubic target_from(const History& history, size_t i, size_t k) {
    const auto at = [&](size_t knot) -> const Vec3d& {
        return history.poses[std::min(knot, history.poses.size() - 1)][k];
    };
    if (i + 1 >= history.times.size()) return {at(i), Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()};
    const double h = history.times[i + 1] - history.times[i];
    if (!history.cubic) return {at(i), (at(i + 1) - at(i)) / h, Vec3d::Zero(), Vec3d::Zero()};
    // Hermite's cubic of the offset, with slopes over two knots; at the first knot, over one. The root: a line.
    const auto offset = [&](size_t knot) -> Vec3d {
        const size_t j = std::min(knot, history.poses.size() - 1);
        return history.poses[j][k] - history.poses[j][0];
    };
    const Vec3d p = offset(i), q = offset(i + 1),
                m = i == 0 ? Vec3d((q - p) / h) : Vec3d((q - offset(i - 1)) / (2.0 * h)),
                n = (offset(i + 2) - p) / (2.0 * h);
    const Vec3d root = history.poses[i][0], root_slope = (history.poses[i + 1][0] - root) / h;
    return {root + p, root_slope + m, (3.0 * (q - p) / h - 2.0 * m - n) / h,
            (2.0 * (p - q) / h + m + n) / (h * h)};
}

} // namespace

std::vector<Vec3d> pose_at(const History& history, double time) {
    const auto after = std::upper_bound(history.times.begin(), history.times.end(), time);
    if (after == history.times.begin()) return history.poses.front();
    if (after == history.times.end()) return history.poses.back();
    const size_t i = size_t(after - history.times.begin());
    std::vector<Vec3d> result;
    for (size_t k = 0; k < history.poses[i - 1].size(); ++k)
        result.push_back(value(target_from(history, i - 1, k), time - history.times[i - 1]));
    return result;
}

std::vector<Vec3d> filtered_pose(const History& history, const std::vector<double>& omega, double zeta,
                                 double time) {
    std::vector<Vec3d> result;
    for (size_t k = 0; k < history.poses.front().size(); ++k) {
        State state{history.poses.front()[k], Vec3d::Zero()};
        for (size_t i = 0; i < history.times.size() && history.times[i] < time; ++i) {
            const bool last = i + 1 == history.times.size();
            const double until = last ? time : std::min(time, history.times[i + 1]);
            advance(state, until - history.times[i], target_from(history, i, k), omega[k], zeta);
        }
        result.push_back(state.x);
    }
    return result;
}

std::vector<Vec3d> restored_lengths(const std::vector<Vec3d>& filtered, const std::vector<Vec3d>& bent,
                                    const std::vector<double>& rest_lengths) {
    std::vector<Vec3d> result{bent.front()};
    for (size_t k = 0; k + 1 < filtered.size(); ++k) {
        Vec3d along = filtered[k + 1] - (k == 0 ? bent.front() : filtered[k]);
        if (along.isZero(0.0)) along = bent[k + 1] - bent[k];
        result.push_back(result.back() + along.stableNormalized() * rest_lengths[k]);
    }
    return result;
}

} // namespace marram::oracle
