// SPDX-License-Identifier: Apache-2.0
// The static pose of a blade under wind and weight: a boundary value problem of the elastica in space.
//
// The blade is an inextensible centreline r(s), 0 <= s <= L, with unit tangent t = r'. It bends equally
// easily in all directions, with rigidity EI(s), and does not twist. A polyline of CVs is its rest shape:
// straight between CVs, with a rigid turn at each. Without loads the pose is the rest shape. Root and
// direction of the first segment at the root are clamped; the tip is free. Loads per length depend on s and t
// alone:
//   q = drag |u_n| u_n + mass g,   u_n = u - (u . t) t,   drag = rho C_d w / 2,
// u the wind, w the width, which faces the wind at any orientation. With the force F and the moment M that
// the part beyond s applies at s,
//   F' + q = 0,  M' + t x F = 0,  F(L) = M(L) = 0,  hence  M(s) = integral_s^L (r(x) - r(s)) x q(x) dx.
// A material frame R(s), whose z axis is t, turns by
//   R' = [k]x R,   k = (M - (M . t) t) / EI,
// between CVs, and by the rest turn in its own axes, R -> R K, at CVs. k is the curvature vector t x t'. Only
// the part of M normal to t bends. The part along t is the reaction that prevents twist: the blade is rigid
// in torsion, so that a rest curvature keeps its place in the frame. For a smooth rest shape, the limit of
// many CVs, M - (M . t) t = EI (t x t' - R k_0), with k_0 the curvature vector at rest in a frame without
// twist.
//
// Dimensionless: Ca = drag U^2 L^3 / EI (Cauchy number) and B = -mass g L^3 / EI (buoyancy).
//
// Method: the chain of elastica_chain.h, with every segment of the rest shape cut into equal pieces. The
// error is of second order in their length. With 400 pieces it is below 3e-5 L at the tip of 99 % of
// random blades with Ca up to 1e4 and |B| up to 50. (4 fine - coarse) / 3, of poses with 2 p and p pieces,
// is of fourth order: within 4e-6 L with 64 and 128 pieces in all. Newton's method follows the equilibrium
// from the rest shape while a factor of all loads grows from 0 to 1, in steps that turn no segment by more
// than about 0.1 radians.
//
// Where the equilibrium ends (a fold) or loses stability to monotone growth (a bifurcation), the overdamped
// flow, c dr/dt = q - the elastic forces, carries the blade from the last stable pose to the next, just past
// the critical load. Then the load grows on. Flutter, an oscillating growth, is reported but not left: it
// depends on damping, and the equilibrium continues.
#pragma once

#include "core/math/vec.h"

#include <vector>

namespace marram::oracle {

// Profiles have a value per CV, linear in arc length between CVs.
struct Blade {
    std::vector<Vec3d> rest;        // CVs, at least 2; neighbours differ and no turn is by 180 degrees
    std::vector<double> rigidity;   // EI in N m^2, positive
    std::vector<double> drag;       // rho C_d w / 2 in kg/m^2
    std::vector<double> mass;       // kg/m; negative: buoyant
    std::vector<double> wind_scale; // factor of the wind; empty: 1
    Vec3d wind = Vec3d::Zero();     // m/s
    Vec3d gravity = Vec3d(0.0, -9.81, 0.0);
};

struct Pose {
    std::vector<Vec3d> points;          // of the CVs
    std::vector<Vec3d> nodes;           // of all ends of pieces
    std::vector<Vec3d> tangents;        // of all pieces
    std::vector<Vec3d> moments, forces; // M in N m and F in N at nodes; at the root those of the clamp
    // False: no stable pose was found beyond `load_factor`, and the pose is that of this load. Either the
    // flow ends in an oscillation, or poses turn freely about an axis (a heavy upright blade without side
    // wind).
    bool converged = false;
    bool snapped = false; // jumped by more than 0.05 L at a fold or a bifurcation
    // Left its branch without a jump. If blade and loads have a plane of symmetry, the mirror image of the
    // pose is as valid.
    bool buckled = false;
    bool flutters = false;    // the pose is unstable to oscillation in the overdamped flow
    double residual = 0.0;    // Newton's last change, in radians
    double load_factor = 0.0; // reached; 1 if converged
};

// `pieces`: in each segment of the rest shape. Time on one core: about 0.01 ms per piece of the blade and
// load step, of which there are 10 to 60; a snap takes as long as several hundred.
Pose elastica(const Blade& blade, int pieces);

} // namespace marram::oracle
