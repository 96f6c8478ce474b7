// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/elastica_chain.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <random>

namespace marram::oracle {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;

Matrix3d skew(const Vec3d& v) {
    Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

Quaterniond rotation(const Vec3d& v) { // exp
    const double half = 0.5 * v.norm();
    const Vec3d xyz = (half < 1e-8 ? 0.5 : 0.5 * std::sin(half) / half) * v;
    return Quaterniond(std::cos(half), xyz.x(), xyz.y(), xyz.z()).normalized();
}

Vec3d rotation_vector(const Quaterniond& q) { // log; angles up to pi
    const double sine = q.vec().norm();
    if (sine < 1e-15) return 2.0 * (q.w() < 0.0 ? -1.0 : 1.0) * q.vec();
    const double angle = 2.0 * std::atan2(sine, std::abs(q.w()));
    return (q.w() < 0.0 ? -angle : angle) / sine * q.vec();
}

// exp(v + dv) = exp(v) exp(right_derivative(v) dv).
Matrix3d right_derivative(const Vec3d& v) {
    const double a = v.norm();
    const Matrix3d s = skew(v);
    const double first = a < 1e-3 ? 0.5 - a * a / 24.0 : (1.0 - std::cos(a)) / (a * a);
    const double second = a < 1e-3 ? 1.0 / 6.0 - a * a / 120.0 : (a - std::sin(a)) / (a * a * a);
    return Matrix3d::Identity() - first * s + second * s * s;
}

Vec3d tangent(const ChainState& state, int i) { return state.frames[size_t(i)] * Vec3d::UnitZ(); }

Vec3d normal_wind(const Vec3d& wind, const Vec3d& t) { return wind - wind.dot(t) * t; }

// d load_per_length / d t. Its drag is |v| v, v = u_n, whose derivative |v| + v v^T / |v| vanishes with v.
Matrix3d load_by_tangent(const Chain& chain, int i, const Vec3d& t) {
    const Vec3d& u = chain.wind[size_t(i)];
    const Vec3d v = normal_wind(u, t);
    const double speed = v.norm();
    if (speed == 0.0) return Matrix3d::Zero();
    const Matrix3d by_v = speed * Matrix3d::Identity() + v * v.transpose() / speed;
    return chain.drag[size_t(i)] * by_v * (-t * u.transpose() - u.dot(t) * Matrix3d::Identity());
}

Vec3d load_at(const Chain& chain, const ChainState& state, const Loading& loading, int i) {
    Vec3d load = loading.factor * load_per_length(chain, i, tangent(state, i));
    if (loading.inverse_step != 0.0)
        load -= loading.inverse_step * (middle(state, i) - (*loading.old_middles)[size_t(i)]);
    return load;
}

// The bend of segment `segment` at one of its ends, in its frame, under the moment of node `node`.
double compliance(const Chain& chain, int segment, int node) {
    return 0.5 * chain.lengths[size_t(segment)] / chain.rigidity[size_t(node)];
}
Vec3d bend(const Chain& chain, const ChainState& state, int segment, int node) {
    const Vec3d m = state.frames[size_t(segment)].conjugate() * state.moments[size_t(node)];
    return compliance(chain, segment, node) * Vec3d(m.x(), m.y(), 0.0);
}

// d (bend in the world) / d M_node, as a rotation after the bend if sign is 1, or of its inverse if -1.
Matrix3d bend_by_moment(const Chain& chain, const ChainState& state, int segment, int node, double sign) {
    const Quaterniond& frame = state.frames[size_t(segment)];
    const Vec3d b = sign * bend(chain, state, segment, node);
    Matrix3d project = Matrix3d::Identity();
    project(2, 2) = 0.0;
    return sign * compliance(chain, segment, node) * (frame * rotation(b)).toRotationMatrix() *
           right_derivative(b) * project * frame.conjugate().toRotationMatrix();
}

Vec3d joint_residual(const Chain& chain, const ChainState& state, int i) {
    Quaterniond inner = chain.turns[size_t(i)];
    if (i > 0) inner = state.frames[size_t(i) - 1] * rotation(bend(chain, state, i - 1, i)) * inner;
    const Quaterniond outer = state.frames[size_t(i)] * rotation(-bend(chain, state, i, i));
    return rotation_vector(outer * inner.conjugate());
}

Eigen::VectorXd random_column(int size) {
    std::mt19937 random(1);
    Eigen::VectorXd column(size);
    for (double& value : column) value = double(random()) / double(std::mt19937::max()) - 0.5;
    return column.normalized();
}

} // namespace

ChainState rest_state(const Chain& chain) {
    ChainState state;
    Quaterniond frame = Quaterniond::Identity();
    state.positions.push_back(Vec3d::Zero());
    for (int i = 0; i < chain.segments(); ++i) {
        frame = (frame * chain.turns[size_t(i)]).normalized();
        state.frames.push_back(frame);
        state.positions.push_back(state.positions.back() +
                                  chain.lengths[size_t(i)] * (frame * Vec3d::UnitZ()));
    }
    state.moments.assign(state.positions.size(), Vec3d::Zero());
    state.forces = state.moments;
    return state;
}

Vec3d middle(const ChainState& state, int i) {
    return 0.5 * (state.positions[size_t(i)] + state.positions[size_t(i) + 1]);
}

Vec3d load_per_length(const Chain& chain, int i, const Vec3d& t) {
    const Vec3d v = normal_wind(chain.wind[size_t(i)], t);
    return chain.drag[size_t(i)] * v.norm() * v + chain.weight[size_t(i)];
}

Blocks residual(const Chain& chain, const ChainState& state, const Loading& loading) {
    Blocks blocks(size_t(chain.segments()));
    for (int i = 0; i < chain.segments(); ++i) {
        const size_t k = size_t(i);
        const Vec3d step = chain.lengths[k] * tangent(state, i);
        const Vec3d load = chain.lengths[k] * load_at(chain, state, loading, i);
        blocks[k] << joint_residual(chain, state, i),
            state.moments[k] - state.moments[k + 1] - step.cross(state.forces[k + 1] + 0.5 * load),
            state.forces[k] - state.forces[k + 1] - load, state.positions[k + 1] - state.positions[k] - step;
    }
    return blocks;
}

void ChainSolver::factor(const ChainState& state, const Loading& loading) {
    const Matrix3d one = Matrix3d::Identity();
    Eigen::Matrix<double, 6, 6> outer_part = Eigen::Matrix<double, 6, 6>::Zero(); // S_{i+1}
    for (int i = chain_.segments() - 1; i >= 0; --i) {
        const size_t k = size_t(i);
        Segment& s = segments_[k];
        const double l = chain_.lengths[k];
        const Vec3d t = tangent(state, i), &m = state.moments[k];
        const Matrix3d t_by_turn = -skew(t);
        const Matrix3d q_by_turn = loading.factor * load_by_tangent(chain_, i, t) * t_by_turn;
        const double q_by_end = -0.5 * loading.inverse_step; // d q_i / d r_i and d r_{i+1}
        const Vec3d middle_force = state.forces[k + 1] + 0.5 * l * load_at(chain_, state, loading, i);
        s.carry.setIdentity();
        s.carry.topRightCorner<3, 3>() = l * skew(t);
        s.by_start << 0.5 * l * l * q_by_end * skew(t), l * q_by_end * one;
        s.own = s.carry * outer_part;
        s.own.topLeftCorner<3, 3>() += 0.5 * l * l * skew(t) * q_by_turn - l * skew(middle_force) * t_by_turn;
        s.own.bottomLeftCorner<3, 3>() += l * q_by_turn;
        s.own.rightCols<3>() += s.by_start;

        // Joint: turn_i + outer (dM_i + M_i x turn_i) - turn_{i-1} - inner (dM_i + M_i x turn_{i-1}). The frame
        // sees M_i turn the other way when it turns itself.
        const Matrix3d outer = bend_by_moment(chain_, state, i, i, -1.0);
        const Matrix3d inner =
            i > 0 ? bend_by_moment(chain_, state, i - 1, i, 1.0) : Matrix3d(Matrix3d::Zero());
        s.by_moment = outer - inner;
        s.move_by_turn = l * t_by_turn;
        const Matrix3d moment_by_end = s.own.topRightCorner<3, 3>();
        s.inverse_pivot = (one + outer * skew(m) +
                           s.by_moment * (s.own.topLeftCorner<3, 3>() + moment_by_end * s.move_by_turn))
                              .inverse();
        Eigen::Matrix<double, 3, 6> turn;
        turn << s.inverse_pivot * (one + inner * skew(m)),
            -s.inverse_pivot * s.by_moment * (moment_by_end + s.by_start.topRows<3>());
        s.step << turn, s.move_by_turn * turn;
        s.step.bottomRightCorner<3, 3>() += one;
        outer_part = s.own * s.step;
        outer_part.rightCols<3>() += s.by_start;
    }
}

Blocks ChainSolver::solve(const Blocks& right_side) const {
    using Vector6 = Eigen::Matrix<double, 6, 1>;
    Blocks x = right_side; // blocks of x_i without X_i x_{i-1}, then of the solution
    Vector6 outer_part = Vector6::Zero();
    for (size_t k = x.size(); k-- > 0;) {
        const Segment& s = segments_[k];
        const Vector6 y = right_side[k].segment<6>(3) + s.carry * outer_part;
        const Vec3d joint = right_side[k].head<3>(), move = right_side[k].tail<3>();
        Vector6 own;
        own.head<3>() =
            s.inverse_pivot * (joint - s.by_moment * (y.head<3>() + s.own.topRightCorner<3, 3>() * move));
        own.tail<3>() = s.move_by_turn * own.head<3>() + move;
        outer_part = s.own * own + y;
        x[k] << own.head<3>(), y, own.tail<3>();
    }
    Vector6 before = Vector6::Zero();
    for (size_t k = 0; k < x.size(); ++k) {
        const Segment& s = segments_[k];
        Vector6 own;
        own << x[k].head<3>(), x[k].tail<3>();
        own += s.step * before;
        x[k].segment<6>(3) += s.own * own + s.by_start * before.tail<3>();
        x[k].head<3>() = own.head<3>();
        x[k].tail<3>() = own.tail<3>();
        before = own;
    }
    return x;
}

Blocks load_side(const Chain& chain, const ChainState& state, const std::vector<Vec3d>& load) {
    Blocks blocks(load.size());
    for (size_t k = 0; k < load.size(); ++k) {
        const Vec3d force = chain.lengths[k] * load[k];
        blocks[k] << Vec3d::Zero(), 0.5 * chain.lengths[k] * tangent(state, int(k)).cross(force), force,
            Vec3d::Zero();
    }
    return blocks;
}

void add(ChainState& state, const Blocks& change, double scale) {
    for (size_t k = 0; k < change.size(); ++k) {
        const Block block = scale * change[k];
        state.frames[k] = (rotation(block.head<3>()) * state.frames[k]).normalized();
        state.moments[k] += block.segment<3>(3);
        state.forces[k] += block.segment<3>(6);
        state.positions[k + 1] += block.tail<3>();
    }
}

double max_rotation(const Blocks& change) {
    double angle = 0.0;
    for (const Block& block : change) {
        if (!block.allFinite()) return infinity;
        angle = std::max(angle, block.head<3>().norm());
    }
    return angle;
}

double max_angle(const ChainState& a, const ChainState& b) {
    double angle = 0.0;
    for (size_t k = 0; k < a.frames.size(); ++k) {
        const Vec3d s = tangent(a, int(k)), t = tangent(b, int(k));
        angle = std::max(angle, std::atan2(s.cross(t).norm(), s.dot(t)));
    }
    return angle;
}

bool ChainSolver::newton(const Loading& loading, double max_turn, ChainState& state, double& error) {
    ChainState trial = state;
    double before = infinity;
    for (int iteration = 0; iteration < 20; ++iteration) {
        factor(trial, loading);
        const Blocks change = solve(residual(chain_, trial, loading));
        error = max_rotation(change);
        if (!(error < max_turn)) return false;
        add(trial, change, -1.0);
        if (max_angle(state, trial) > max_turn) return false;
        if (error < 1e-13 || (error < 1e-8 && error > 0.5 * before)) { // rounding ends the fast convergence
            state = trial;
            return true;
        }
        before = error;
    }
    return false;
}

// Load and returned displacement: 3 numbers per segment, scaled so that dot products are integrals over s.
Eigen::VectorXd ChainSolver::response(const ChainState& state, const Eigen::VectorXd& load,
                                      Blocks& change) const {
    const int n = chain_.segments();
    std::vector<Vec3d> per_length;
    for (int i = 0; i < n; ++i)
        per_length.push_back(load.segment<3>(3 * i) / std::sqrt(chain_.lengths[size_t(i)]));
    change = solve(load_side(chain_, state, per_length));
    Eigen::VectorXd displacement(3 * n);
    Vec3d before = Vec3d::Zero();
    for (int i = 0; i < n; ++i) {
        const Vec3d after = change[size_t(i)].tail<3>();
        displacement.segment<3>(3 * i) = std::sqrt(chain_.lengths[size_t(i)]) * 0.5 * (before + after);
        before = after;
    }
    return displacement;
}

Growth ChainSolver::growth(const ChainState& state, double load) {
    // T maps a load to the displacement that it causes. In the flow the additional load is -dr/dt, so that an
    // eigenvector of T with eigenvalue theta varies as exp(-t / theta).
    factor(state, Loading{load});
    Blocks change;
    const int modes = std::min(24, 2 * chain_.segments());
    std::vector<Eigen::VectorXd> basis{random_column(3 * chain_.segments())};
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(modes + 1, modes);
    int size = 0;
    while (size < modes) {
        Eigen::VectorXd next = response(state, basis.back(), change);
        for (int repeat = 0; repeat < 2; ++repeat) // the second removes the rounding of the first
            for (int j = 0; j <= size; ++j) {
                const double part = basis[size_t(j)].dot(next);
                h(j, size) += part;
                next -= part * basis[size_t(j)];
            }
        h(size + 1, size) = next.norm();
        ++size;
        if (h(size, size - 1) < 1e-14 * std::abs(h(0, 0))) break;
        basis.push_back(next.normalized());
    }
    const Eigen::EigenSolver<Eigen::MatrixXd> eigen(h.topLeftCorner(size, size));
    Growth growth;
    for (int j = 0; j < size; ++j) {
        const std::complex<double> theta = eigen.eigenvalues()[j], rate = -1.0 / theta;
        const double uncertainty = h(size, size - 1) * std::abs(eigen.eigenvectors()(size - 1, j));
        double& side = std::abs(rate.imag()) < std::abs(rate.real()) ? growth.divergence : growth.flutter;
        if (uncertainty < 0.1 * std::abs(theta)) side = std::max(side, rate.real());
    }
    return growth;
}

Blocks ChainSolver::perturbation(const ChainState& state, double load) {
    factor(state, Loading{load});
    Blocks change;
    response(state, random_column(3 * chain_.segments()), change);
    const double scale = 1.0 / max_rotation(change);
    for (Block& block : change) block *= scale;
    return change;
}

} // namespace marram::oracle
