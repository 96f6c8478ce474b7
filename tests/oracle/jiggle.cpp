// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/jiggle.h"

#include <algorithm>

namespace marram::oracle {
namespace {

struct State {
    Vec3d x, velocity;
};

// Advances by `time` with the target g + slope t. The three components are independent.
void advance(State& state, double time, const Vec3d& g, const Vec3d& slope, double omega, double zeta) {
    constexpr double longest = 0.25; // in 1 / (omega max(1, 2 zeta)), see jiggle.h
    constexpr int terms = 16;
    const int steps = std::max(1, int(std::ceil(time * omega * std::max(1.0, 2.0 * zeta) / longest)));
    const double h = time / steps;
    for (int step = 0; step < steps; ++step) {
        Vec3d derivative[terms + 2] = {state.x, state.velocity};
        Vec3d target = g + slope * (h * step);
        for (int n = 0; n < terms; ++n) {
            derivative[n + 2] = -2.0 * zeta * omega * derivative[n + 1] - omega * omega * derivative[n] +
                                omega * omega * target;
            target = n == 0 ? slope : Vec3d::Zero();
        }
        state = {Vec3d::Zero(), Vec3d::Zero()};
        for (int n = terms; n >= 0; --n) { // Horner's scheme
            state.x = derivative[n] + state.x * (h / (n + 1));
            state.velocity = derivative[n + 1] + state.velocity * (h / (n + 1));
        }
    }
}

} // namespace

std::vector<Vec3d> pose_at(const History& history, double time) {
    const auto after = std::upper_bound(history.times.begin(), history.times.end(), time);
    if (after == history.times.begin()) return history.poses.front();
    if (after == history.times.end()) return history.poses.back();
    const size_t i = size_t(after - history.times.begin());
    const double t = (time - history.times[i - 1]) / (history.times[i] - history.times[i - 1]);
    std::vector<Vec3d> pose = history.poses[i - 1];
    for (size_t k = 0; k < pose.size(); ++k) pose[k] += t * (history.poses[i][k] - pose[k]);
    return pose;
}

std::vector<Vec3d> filtered_pose(const History& history, const std::vector<double>& omega, double zeta,
                                 double time) {
    std::vector<Vec3d> result;
    for (size_t k = 0; k < history.poses.front().size(); ++k) {
        State state{history.poses.front()[k], Vec3d::Zero()};
        for (size_t i = 0; i < history.times.size() && history.times[i] < time; ++i) {
            const bool last = i + 1 == history.times.size();
            const double until = last ? time : std::min(time, history.times[i + 1]);
            const Vec3d g = history.poses[i][k];
            const Vec3d slope =
                last ? Vec3d::Zero()
                     : Vec3d((history.poses[i + 1][k] - g) / (history.times[i + 1] - history.times[i]));
            advance(state, until - history.times[i], g, slope, omega[k], zeta);
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
