// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/elastica.h"

#include "tests/oracle/elastica_chain.h"

#include <algorithm>

namespace marram::oracle {
namespace {

constexpr double max_step_turn = 0.1;   // of a segment in a step of load or time, radians
constexpr double min_step_turn = 1e-4;  // a load step below it means a fold or a bifurcation
constexpr double max_load_step = 0.1;   // of the load factor
constexpr double perturbed_turn = 1e-3; // of the perturbation at the start of the flow, radians
constexpr double neutral_growth = 1e-9; // growth rates below it are rounding
constexpr double max_buckling = 0.05;   // of the length; larger displacements in the flow are snaps
constexpr int max_load_steps = 2000, max_flow_steps = 1500, max_flows = 10;

double interpolated(const std::vector<double>& profile, size_t segment, double u) {
    return profile[segment] + u * (profile[segment + 1] - profile[segment]);
}

// The shortest rotation between unit vectors that are not opposite.
Eigen::Quaterniond shortest(const Vec3d& from, const Vec3d& to) {
    const Vec3d sine = from.cross(to);
    return Eigen::Quaterniond(1.0 + from.dot(to), sine.x(), sine.y(), sine.z()).normalized();
}

// The frame of the clamp. Its x and y axes are arbitrary.
Eigen::Quaterniond clamp_frame(const Vec3d& t) {
    if (t.z() > 0.0) return shortest(Vec3d::UnitZ(), t);
    return shortest(-Vec3d::UnitZ(), t) * Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0);
}

Chain make_chain(const Blade& blade, int pieces, double length) {
    Chain chain;
    const double unit = blade.rigidity[0] / (length * length * length); // of loads per length
    Vec3d before = Vec3d::Zero();
    Eigen::Quaterniond frame = Eigen::Quaterniond::Identity();
    for (size_t s = 0; s + 1 < blade.rest.size(); ++s) {
        const Vec3d span = blade.rest[s + 1] - blade.rest[s], t = span.stableNormalized();
        const Eigen::Quaterniond turn =
            s == 0 ? clamp_frame(t) : (frame.conjugate() * shortest(before, t) * frame).normalized();
        frame = (frame * turn).normalized();
        before = t;
        for (int piece = 0; piece < pieces; ++piece) {
            const double start = double(piece) / pieces, middle = (piece + 0.5) / pieces;
            chain.lengths.push_back(span.stableNorm() / (pieces * length));
            chain.turns.push_back(piece == 0 ? turn : Eigen::Quaterniond::Identity());
            chain.rigidity.push_back(interpolated(blade.rigidity, s, start) / blade.rigidity[0]);
            const double scale = blade.wind_scale.empty() ? 1.0 : interpolated(blade.wind_scale, s, middle);
            chain.wind.push_back(scale * blade.wind);
            chain.drag.push_back(interpolated(blade.drag, s, middle) / unit);
            chain.weight.push_back(interpolated(blade.mass, s, middle) / unit * blade.gravity);
        }
    }
    return chain;
}

double max_distance(const ChainState& a, const ChainState& b) {
    double distance = 0.0;
    for (size_t k = 0; k < a.positions.size(); ++k)
        distance = std::max(distance, (a.positions[k] - b.positions[k]).norm());
    return distance;
}

// The overdamped flow at a constant load to a pose without divergence, in implicit Euler steps. They are
// short against the fastest growth: longer ones would converge to the unstable pose.
bool relax(const Chain& chain, ChainSolver& solver, double load, ChainState& state, double& error) {
    add(state, solver.perturbation(state, load), perturbed_turn);
    double step = 1e-6;
    for (int count = 0; count < max_flow_steps; ++count) {
        const double growth = solver.growth(state, load).divergence;
        if (std::abs(growth) < neutral_growth) return false;
        if (growth < 0.0 && count > 0) {
            ChainState trial = state;
            if (solver.newton(Loading{load}, max_step_turn, trial, error) &&
                solver.growth(trial, load).divergence < 0.0) {
                state = trial;
                return true;
            }
        }
        if (growth > 0.0) step = std::min(step, 0.5 / growth);
        std::vector<Vec3d> middles;
        for (int i = 0; i < chain.segments(); ++i) middles.push_back(middle(state, i));
        while (!solver.newton(Loading{load, 1.0 / step, &middles}, max_step_turn, state, error))
            if ((step *= 0.5) < 1e-14) return false;
        step *= 1.5;
    }
    return false;
}

// Follows the stable equilibrium to a higher load. False: none within the smallest step; `load` is then that
// step's load, and `state` is unchanged.
bool step_load(const Chain& chain, ChainSolver& solver, double& load, ChainState& state, double& error) {
    std::vector<Vec3d> full_load;
    for (int i = 0; i < chain.segments(); ++i)
        full_load.push_back(load_per_length(chain, i, state.frames[size_t(i)] * Vec3d::UnitZ()));
    solver.factor(state, Loading{load});
    const Blocks by_load = solver.solve(load_side(chain, state, full_load));
    const double start = load;
    double step = std::min({max_load_step, 1.0 - load, max_step_turn / max_rotation(by_load)});
    for (double turn = max_step_turn; turn > min_step_turn; turn *= 0.5, step *= 0.5) {
        load = start + step > 1.0 - 1e-12 ? 1.0 : start + step;
        ChainState trial = state;
        add(trial, by_load, load - start);
        // The corrections are small and the pose is stable: it is on the same branch.
        if (solver.newton(Loading{load}, 0.5 * max_step_turn, trial, error) &&
            solver.growth(trial, load).divergence < 0.0) {
            state = trial;
            return true;
        }
    }
    return false;
}

} // namespace

Pose elastica(const Blade& blade, int pieces) {
    double length = 0.0;
    for (size_t s = 0; s + 1 < blade.rest.size(); ++s) length += (blade.rest[s + 1] - blade.rest[s]).norm();
    const Chain chain = make_chain(blade, pieces, length);
    ChainSolver solver(chain);
    ChainState state = rest_state(chain);
    Pose pose;
    int flows = 0;
    for (int step = 0; pose.load_factor < 1.0 && step < max_load_steps; ++step) {
        double load = pose.load_factor;
        if (!step_load(chain, solver, load, state, pose.residual)) {
            ChainState relaxed = state;
            if (++flows > max_flows || !relax(chain, solver, load, relaxed, pose.residual)) break;
            (max_distance(relaxed, state) > max_buckling ? pose.snapped : pose.buckled) = true;
            state = relaxed;
        }
        pose.load_factor = load;
    }
    pose.converged = pose.load_factor == 1.0;
    pose.flutters = solver.growth(state, pose.load_factor).flutter > 0.0;

    const double unit = blade.rigidity[0] / (length * length); // of forces
    for (size_t k = 0; k < state.positions.size(); ++k) {
        pose.nodes.push_back(blade.rest[0] + length * state.positions[k]);
        if (k % size_t(pieces) == 0) pose.points.push_back(pose.nodes.back());
        pose.moments.push_back(length * unit * state.moments[k]);
        pose.forces.push_back(unit * state.forces[k]);
    }
    for (const Eigen::Quaterniond& frame : state.frames) pose.tangents.push_back(frame * Vec3d::UnitZ());
    return pose;
}

} // namespace marram::oracle
