// SPDX-License-Identifier: Apache-2.0
// Wanted are strengths s_j at speeds j and a profile m_i at knots i along the strands that minimise
//
//     sum over j and segments k of  w_k |b_k(s_j m) - d_jk|^2
//
// with directions d to be met, and those that bend() gives, b(p), for strengths p at the knots. bend() is
// not known here, only called: whatever turns strands by a factor along them can be fitted.
//
// Levenberg-Marquardt. At each speed p = s_j m, so one Jacobian D_j = db/dp serves both unknowns. With G_j
// = D_j^T W D_j and g_j = D_j^T W (b - d), the normal equations are
//
//     [ m^T G_j m        s_j m^T G_j    ] [ds_j]     [ m^T g_j       ]
//     [ s_j G_j m    sum_j s_j^2 G_j    ] [dm  ] = - [ sum_j s_j g_j ]
//
// D_j is a difference quotient, one call of bend() a knot. The scale that s and m share is left open by the
// equations; damping keeps it, and m is scaled to a maximum of 1. After each step s is made to ascend by
// pooling neighbours that do not (isotonic regression), m and s are cut off at 0. The search begins from a
// profile of 1 and, at each speed, the best of a few strengths: residuals are smooth from there on.
#include "core/measure/bend_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace marram {
namespace {

using Numbers = std::vector<double>;
using Matrix = Eigen::MatrixXd;
using Column = Eigen::VectorXd;

constexpr std::array first_strengths = {0.0, 0.01, 0.03, 0.07, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95};

double squared_distance(const BendTargets& targets, size_t speed, const Directions& bent) {
    double sum = 0.0;
    for (size_t k = 0; k < bent.size(); ++k)
        sum += targets.weights[k] * (bent[k] - targets.directions[speed][k]).squaredNorm();
    return sum;
}

struct Pose { // s, m and what follows from them
    Numbers strengths, profile;
    std::vector<Directions> bent; // [speed]
    double squares = 0.0;

    Numbers at_knots(size_t speed) const {
        Numbers product = profile;
        for (double& p : product) p *= strengths[speed];
        return product;
    }
};

void evaluate_pose(const BendTargets& targets, const Bend& bend, Pose& pose) {
    pose.squares = 0.0;
    pose.bent.clear();
    for (size_t j = 0; j < targets.directions.size(); ++j) {
        pose.bent.push_back(bend(pose.at_knots(j)));
        pose.squares += squared_distance(targets, j, pose.bent[j]);
    }
}

// Pools neighbours that descend into their mean.
void make_ascending(Numbers& values) {
    std::vector<std::pair<double, size_t>> pools; // mean, count
    for (const double value : values) {
        pools.emplace_back(std::max(value, 0.0), 1);
        while (pools.size() > 1 && pools[pools.size() - 2].first > pools.back().first) {
            const auto [mean, count] = pools.back();
            pools.pop_back();
            auto& before = pools.back();
            before.first =
                (before.first * double(before.second) + mean * double(count)) / double(before.second + count);
            before.second += count;
        }
    }
    values.clear();
    for (const auto& [mean, count] : pools) values.insert(values.end(), count, mean);
}

// The largest of the profile becomes 1. The products stay.
void scale_profile(Pose& pose) {
    const double most = std::ranges::max(pose.profile);
    if (!(most > 0.0)) return;
    for (double& m : pose.profile) m /= most;
    for (double& s : pose.strengths) s *= most;
}

Pose first_pose(const BendTargets& targets, const Bend& bend) {
    const size_t speeds = targets.directions.size();
    Pose pose{Numbers(speeds, 0.0), Numbers(targets.knots, 1.0), {}, 0.0};
    Numbers best(speeds, INFINITY);
    for (const double strength : first_strengths) {
        const Directions bent = bend(Numbers(targets.knots, strength));
        for (size_t j = 0; j < speeds; ++j)
            if (const double squares = squared_distance(targets, j, bent); squares < best[j]) {
                best[j] = squares;
                pose.strengths[j] = strength;
            }
    }
    make_ascending(pose.strengths);
    evaluate_pose(targets, bend, pose);
    return pose;
}

// G_j and g_j of the head comment.
struct Slopes {
    Matrix curvature;
    Column gradient;
};

Slopes slopes_at(const BendTargets& targets, const Bend& bend, const Pose& pose, size_t speed) {
    constexpr double step = 0.01;
    const Directions &bent = pose.bent[speed], &wanted = targets.directions[speed];
    const auto knots = Eigen::Index(targets.knots);
    std::vector<Directions> slopes;
    for (size_t i = 0; i < targets.knots; ++i) {
        Numbers at_knots = pose.at_knots(speed);
        const double by = at_knots[i] > 0.5 ? -step : step;
        at_knots[i] += by;
        Directions& slope = slopes.emplace_back(bend(at_knots));
        for (size_t k = 0; k < bent.size(); ++k) slope[k] = (slope[k] - bent[k]) / by;
    }
    Slopes sums{Matrix::Zero(knots, knots), Column::Zero(knots)};
    for (size_t k = 0; k < bent.size(); ++k)
        for (size_t i = 0; i < targets.knots; ++i) {
            const Vec3d weighted = targets.weights[k] * slopes[i][k];
            sums.gradient[Eigen::Index(i)] += weighted.dot(bent[k] - wanted[k]);
            for (size_t l = 0; l < targets.knots; ++l)
                sums.curvature(Eigen::Index(i), Eigen::Index(l)) += weighted.dot(slopes[l][k]);
        }
    return sums;
}

// The step of the head comment: ds, then dm.
Column damped_step(const Pose& pose, const std::vector<Slopes>& slopes, double damping) {
    const auto speeds = Eigen::Index(slopes.size()), knots = Eigen::Index(pose.profile.size());
    const Eigen::Map<const Column> m(pose.profile.data(), knots);
    Matrix normal = Matrix::Zero(speeds + knots, speeds + knots);
    Column right = Column::Zero(speeds + knots);
    for (Eigen::Index j = 0; j < speeds; ++j) {
        const Slopes& at = slopes[size_t(j)];
        const double s = pose.strengths[size_t(j)];
        const Column turned = at.curvature * m;
        normal(j, j) = m.dot(turned);
        normal.block(speeds, j, knots, 1) = s * turned;
        normal.block(j, speeds, 1, knots) = s * turned.transpose();
        normal.block(speeds, speeds, knots, knots) += s * s * at.curvature;
        right[j] = -m.dot(at.gradient);
        right.tail(knots) -= s * at.gradient;
    }
    const double floor = 1e-9 * std::max(normal.diagonal().maxCoeff(), 1e-300);
    for (Eigen::Index i = 0; i < normal.rows(); ++i) normal(i, i) += damping * normal(i, i) + floor;
    return normal.ldlt().solve(right);
}

Pose stepped(const Pose& from, const Column& step) {
    Pose to{from.strengths, from.profile, {}, 0.0};
    const size_t speeds = to.strengths.size();
    for (size_t j = 0; j < speeds; ++j) to.strengths[j] += step[Eigen::Index(j)];
    for (size_t i = 0; i < to.profile.size(); ++i)
        to.profile[i] = std::max(to.profile[i] + step[Eigen::Index(speeds + i)], 0.0);
    make_ascending(to.strengths);
    scale_profile(to);
    return to;
}

} // namespace

BendFit fit_bend(const BendTargets& targets, const Bend& bend, const std::function<bool()>& enough) {
    constexpr int max_steps = 12, max_tries = 5;
    constexpr double converged = 1e-3; // relative fall of the squares
    Pose pose = first_pose(targets, bend);
    BendFit fit;
    double damping = 1e-2;
    for (bool falls = true; falls && fit.steps < max_steps && !enough();) {
        std::vector<Slopes> slopes;
        for (size_t j = 0; j < targets.directions.size(); ++j)
            slopes.push_back(slopes_at(targets, bend, pose, j));
        falls = false;
        for (int tries = 0; tries < max_tries && !enough(); ++tries) {
            Pose next = stepped(pose, damped_step(pose, slopes, damping));
            evaluate_pose(targets, bend, next);
            if (!(next.squares < pose.squares)) {
                damping *= 8.0;
                continue;
            }
            damping = std::max(damping / 4.0, 1e-6);
            falls = next.squares < (1.0 - converged) * pose.squares;
            pose = std::move(next);
            ++fit.steps;
            break;
        }
    }
    scale_profile(pose);
    fit.strengths = std::move(pose.strengths);
    fit.profile = std::move(pose.profile);
    fit.residual = std::sqrt(pose.squares / double(std::max(targets.directions.size(), size_t(1))));
    return fit;
}

// Douglas and Peucker: the value farthest from the line between two knots that are kept is kept, too.
std::vector<Vec2d> fewer_knots(const std::vector<Vec2d>& knots, double tolerance) {
    std::vector<char> kept(knots.size(), 0);
    kept.front() = kept.back() = 1;
    std::vector<std::pair<size_t, size_t>> spans = {{0, knots.size() - 1}};
    while (!spans.empty()) {
        const auto [first, last] = spans.back();
        spans.pop_back();
        double most = tolerance;
        size_t farthest = first;
        for (size_t i = first + 1; i < last; ++i) {
            const double t = (knots[i].x() - knots[first].x()) / (knots[last].x() - knots[first].x());
            const double line = knots[first].y() + t * (knots[last].y() - knots[first].y());
            if (const double off = std::abs(knots[i].y() - line); off > most) most = off, farthest = i;
        }
        if (farthest == first) continue;
        kept[farthest] = 1;
        spans.emplace_back(first, farthest);
        spans.emplace_back(farthest, last);
    }
    std::vector<Vec2d> result;
    for (size_t i = 0; i < knots.size(); ++i)
        if (kept[i]) result.push_back(knots[i]);
    return result;
}

} // namespace marram
