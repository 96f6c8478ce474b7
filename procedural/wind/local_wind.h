// SPDX-License-Identifier: Apache-2.0
// Fields: places where the wind differs from the mean wind, such as whirls, draughts, shelters and simulated
// air.
//
//     v(P) = V = speed w, changed by each field in the order of the scene:
//     v <- v + s A(x)            mode "add"
//     v <- v + s (F(x) - v)      mode "replace"
//     x = M (P - C),    s = weight * ramp(t) where t < 1, else 0: there the wind keeps its bits
//
//     shape     t                      F                                                             A
//     sphere    |x|                    R (velocity + swirl c(rho) e_phi - pull c(r) e_r)             F
//     box       the largest |x_a|      the same                                                      F
//     grid      the largest |x_a|      R v_file(x): its velocities, trilinear, linear in time        F
//     image     larger of |x|, |z|     along V + across V_perp, V_perp = (-V_z, 0, V_x)              F - V
//     curves    distance / 4 reach     V turned towards them (field/guide_map.h)                     F - V
//
// with c(q) = 2 (q / core) / (1 + (q / core)^2).
//
// C, R and M = (R * scale)^-1 are from the field's keyed transform. Swirl is about the field's y axis, rho
// the distance from it and r that from the centre, both in units of the field's size. c is the profile of
// Scully's vortex (M. P. Scully, MIT ASRL TR 178-1, 1975), scaled to 1 at q = core: 0 in the middle, falling
// as 1 / q outside, and smooth. A scale that differs between axes stretches where a field is, not the speeds.
//
// A grid (field/velocities.h) is where its file says, and the field's transform comes on top; its box is that
// of the file's active voxels, outside of which there is the mean wind. A sequence takes the files before and
// after the time, each with its own box and ramp, and their shares of the time: before the first and after
// the last file that file alone, also for the past that jiggle reads. An image covers -1 ... 1 in x and z of
// the field, at any height: its columns run along +x, its rows along +z from the top. Images and curves are
// seen from above and relative to the mean wind.
//
// A strand takes the wind at its root: the direction of v is what it turns towards, and response(|v|) its
// strength. With fields_at = "cv" each CV takes the fields where it is at rest, so that one strand can lean
// two ways, as under the edge of a rotor. Where wind.over names ground, v starts as the wind over it
// (ground_air.h), half as high above the root as the strand rises, or a tenth of its reach if that is more:
// one for all CVs. Noise and gusts are carried by the
// mean wind: carried by v, they would be sheared without end. Rays for shelter go upwind of the mean wind.
//
// ERROR: in double, samples in float; the response is stored as a float, off by less than 1e-6
// (local_wind_test.cpp, field_shapes_test.cpp). COST: tens of nanoseconds a root and
// field, least in a sphere, most between two frames of a staggered grid (marram_bench, "field", prints each);
// a patch outside a field does not pay for it. With fields_at = "cv" each CV costs what a root does.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "procedural/air/ground_air.h"
#include "procedural/wind/field/placed_field.h"
#include "procedural/wind/strands.h"

#include <span>

namespace marram {

struct LocalWind {
    Vec3d direction; // of the mean wind
    double speed;
    const Ramp& response;
    std::span<const FieldAt> fields;
    GroundAir::At ground{}; // over which it blows, if any: fields change what the ground has made of it
    SpeedHeight reference{};
    bool shielded = false; // rays find shelter, too
    bool at_cvs = false;   // fields act at each CV, not at the root
};
// Sets strands.wind_direction, wind_speed and wind_response, from strands.rest; and, with `shielded` and
// ground, strands.wind_unsheltered.
void local_wind(const LocalWind& wind, Strands& strands);

} // namespace marram
