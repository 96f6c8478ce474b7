// SPDX-License-Identifier: Apache-2.0
// bend = "blade": strands bend as elastic blades do in moving air, instead of by the talk's dials.
//
// MODEL. A strand is an inextensible rod, clamped at its root, that bends by its moment over its rigidity
// EI and does not twist (elastica.cpp has the equations). At each point act, per length,
//
//     drag      1/2 air_density drag width |u_n| u_n        u_n: the part of the wind u that is normal to the strand
//     weight    mass g, downwards
//
// with u = U (w + amplitude * noise) at the middle of each segment: w and noise as in bend.cpp, and the speed
//
//     U = speed * (calm + gusts) * (1 - shield * sheltered) * envelope
//
// with speed and w those at the root where the wind has fields or flows over ground, times the share that a
// canopy lets through. So gusts and shelter change the speed, and drag goes with its square. `response`,
// `global_rotate`, `ramp_rotate` and `reference_segments` have no meaning here.
//
// The groomed shape is that of still air, weight included: a blade that droops at rest does so without
// wind. With sags = true it is the shape without weight, which then bends it further. An upright blade of
// mass g L^3 / EI above 7.84 (A. Greenhill, 1881) cannot carry itself: its groomed pose is unstable, and
// the least wind lays it down.
//
// EI and mass are those at the root, where a strand is as wide as width times width_profile. Along a strand
// of width profile p(u), a flat one (ribbon) of constant thickness has EI and mass in proportion to p, a
// round one to p^4 and p^2; `taper` replaces that of EI, relative to its value at the root, and EI is at
// least a thousandth of that at the root. A strand of another width than the groom's has EI and mass by the
// same powers.
//
// The rigidity is one of: stiffness, EI; or modulus E, and EI = E width thickness^3 / 12, or E pi width^4 /
// 64 if round; or frequency, the first natural frequency of a strand of the groom's mean length, from which
// EI follows with the mass. A species gives modulus, density, thickness and drag where they are not given;
// its sources are in scenes/README.md. To add one: a row in blade.cpp, its name in the choices of
// blade.species, and what was read about both its stiffness and its mass. If anything of jiggle is given
// but its frequency, that is the blade's.
//
// Quasi-static: added mass, lift and the blade's own speed are left out (jiggle stands for inertia and
// damping).
#pragma once

#include "core/math/ramp.h"
#include "procedural/abi/values.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace marram {

struct Blade {
    bool flat = true;
    double width = 0.0;    // m: that of the groom, before width_profile
    double rigidity = 0.0; // N m^2, at the root of a strand of that width
    double mass = 0.0;     // kg / m, likewise
    double drag = 1.2;     // coefficient
    double air_density = 1.225;
    Ramp taper, mass_taper; // of rigidity and mass over u, relative to the root
    Ramp width_profile;     // over u, of the width
    bool sags = false;
    double mean_length = 0.0; // m
    std::string place;        // in the scene, for messages
    int pieces = 1;           // by resolve_blades(): parts of a segment that are solved for
    double tolerance = 1e-3;  // likewise, m
};

// What a groom tells of its strands.
struct BladeShape {
    bool flat = true;
    double width = 0.0, mean_length = 0.0; // m
    Ramp width_profile;
};

std::span<const MarramParam> blade_params();
// Empty unless bend = "blade". Throws SceneFault.
std::optional<Blade> read_blade(const Values& values, const BladeShape& shape);

// First natural frequency of a strand of this length, Hz: a cantilever that swings in still air. To 1e-4 of
// that of a uniform beam.
double natural_frequency(const Blade& blade, double length);

// m g L^3 / EI of a strand of mean length: above 7.84 a uniform one cannot stand upright.
double weight_number(const Blade& blade);

// Sets how finely blades are solved, for a frame's tolerance (m; 0: a thousandth of their length) and
// strands up to `longest` metres of `cvs` CVs.
void resolve_blades(const Wind& wind, int cvs, double longest, double tolerance, Blade& blade);

// strands.rest -> strands.pose. `wind`: one that bends blades, at the frame; strands.envelope: of it.
// Returns the number of strands whose equations were not solved to the tolerance: they have the pose
// whose next step was smallest.
uint64_t bend_blades(const Wind& wind, const Blade& blade, double frame, double fps, Strands& strands);

} // namespace marram
