// SPDX-License-Identifier: Apache-2.0
// The discrete equations of elastica.h, their linearisation, and the growth rate of perturbations.
//
// All quantities are dimensionless: lengths in L, moments in EI_0 / L, forces in EI_0 / L^2, loads per length
// in EI_0 / L^3, with EI_0 the rigidity at the root. Time is in c L^4 / EI_0, with c the viscous resistance
// per length of the overdamped flow: it replaces the load q by q - dr/dt.
//
// The chain has n straight segments. Segment i has a frame R_i, whose z axis is its tangent t_i, and carries
// its load q_i at its middle. Each end of a segment bends by a hinge that stands for half of it:
//   joint     R_i exp(-l_i P R_i^T M_i / (2 EI_i)) = R_{i-1} exp(l_{i-1} P R_{i-1}^T M_i / (2 EI_i)) K_i,
//   moment    M_i = M_{i+1} + l_i t_i x (F_{i+1} + l_i q_i / 2),   M_n = 0,
//   force     F_i = F_{i+1} + l_i q_i,                             F_n = 0,
//   position  r_{i+1} = r_i + l_i t_i,                             r_0 = the root.
// P sets the z component to zero, since the blade does not twist. K_i is the rest turn of the joint, in the
// frame of the segment before. At the root the right side is the clamp's frame K_0. Splitting the hinge
// between the two segments makes the rule symmetric: errors are of second order, at kinks and at the clamp
// too.
#pragma once

#include "core/math/vec.h"

#include <vector>

namespace marram::oracle {

struct Chain {
    std::vector<double> lengths;           // l_i
    std::vector<double> rigidity;          // EI_i at the n first nodes
    std::vector<Eigen::Quaterniond> turns; // K_i at the n first nodes
    std::vector<Vec3d> wind;               // u_i at the middle of each segment
    std::vector<double> drag;              // q_drag = drag_i |u_n| u_n
    std::vector<Vec3d> weight;             // q_weight
    int segments() const { return int(lengths.size()); }
};

// Orientations of the n segments; moments, forces and positions of the n + 1 nodes.
struct ChainState {
    std::vector<Eigen::Quaterniond> frames;
    std::vector<Vec3d> moments, forces, positions;
};

// No loads, root at the origin.
ChainState rest_state(const Chain& chain);
Vec3d middle(const ChainState& state, int segment);
// q_drag + q_weight of a segment at load factor 1.
Vec3d load_per_length(const Chain& chain, int segment, const Vec3d& tangent);

// Loads and, if `inverse_step` is not 0, the resistance of an implicit Euler step of the overdamped flow.
struct Loading {
    double factor = 1.0;
    double inverse_step = 0.0;               // 1 / dt
    const std::vector<Vec3d>* old_middles{}; // before the step
};

// Changes of a segment's rotation vector (in the world), M_i, F_i and r_{i+1}, in this order.
using Block = Eigen::Matrix<double, 12, 1>;
using Blocks = std::vector<Block>;

// Left minus right side of the equations of every segment: joint (as a rotation vector), moment, force,
// position.
Blocks residual(const Chain& chain, const ChainState& state, const Loading& loading);

// The right side of the linear equations for a small additional load per length on every segment.
Blocks load_side(const Chain& chain, const ChainState& state, const std::vector<Vec3d>& load);

// state += scale change.
void add(ChainState& state, const Blocks& change, double scale);
double max_rotation(const Blocks& change);
// The largest angle by which the tangent of a segment differs.
double max_angle(const ChainState& a, const ChainState& b);

// The largest real parts of the growth rates of small perturbations in the overdamped flow: of rates whose
// imaginary part is smaller, and of the others. Negative: decay.
struct Growth {
    double divergence = -infinity, flutter = -infinity;
};

// Linear equations with the derivative of `residual`, factored by a sweep from the tip to the root. Let x_i
// be the changes of segment i's rotation and of r_{i+1}, and y_i those of M_i and F_i. The part of the blade
// beyond node i + 1 responds with y_{i+1} = S_{i+1} x_i. Segment i's equations then give x_i = X_i x_{i-1}
// and y_i = S_i x_{i-1}. Every pivot is a 3x3 matrix: the joint that carries the whole outer part. It is
// regular where the outer part, clamped at its first node, is stable.
class ChainSolver {
  public:
    explicit ChainSolver(const Chain& chain) : chain_(chain), segments_(chain.lengths.size()) {}
    void factor(const ChainState& state, const Loading& loading);
    Blocks solve(const Blocks& right_side) const;

    // Newton's method for `residual` = 0, to rounding. False: no convergence, or a segment would turn by more
    // than max_turn from where it was; then `state` is unchanged. `error`: the last change, in radians.
    bool newton(const Loading& loading, double max_turn, ChainState& state, double& error);
    // At a load without resistance. Arnoldi's method, which finds the slow modes of either sign first.
    Growth growth(const ChainState& state, double load);
    // The response to random loads, mostly of the slowest modes, with a largest rotation of 1. The same for
    // the same number of segments.
    Blocks perturbation(const ChainState& state, double load);

  private:
    struct Segment {
        Eigen::Matrix3d inverse_pivot, by_moment, move_by_turn;
        Eigen::Matrix<double, 6, 6> carry, own, step; // d y_i / d y_{i+1}; d y_i / d x_i with S_{i+1}; X_i
        Eigen::Matrix<double, 6, 3> by_start;         // d y_i / d r_i
    };
    Eigen::VectorXd response(const ChainState& state, const Eigen::VectorXd& load, Blocks& change) const;

    const Chain& chain_;
    std::vector<Segment> segments_;
};

} // namespace marram::oracle
