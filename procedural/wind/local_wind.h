// SPDX-License-Identifier: Apache-2.0
// Fields: places where the wind differs from the mean wind, such as whirls, draughts and shelters.
//
//     v(P) = speed w, changed by each field in the order of the scene:
//     v <- v + s F(x)            mode "add"
//     v <- v + s (F(x) - v)      mode "replace"
//     x = M (P - C),    s = weight * ramp(t) where t < 1, else 0
//     t = |x| of a sphere, the largest |x_a| of a box
//     F = R (velocity + swirl c(rho) e_phi - pull c(r) e_r),    c(q) = 2 (q / core) / (1 + (q / core)^2)
//
// C, R and M = (R * scale)^-1 are from the field's keyed transform. Swirl is about the field's y axis, rho
// the distance from it and r that from the centre, both in units of the field's size. c is the profile of
// Scully's vortex (M. P. Scully, MIT ASRL TR 178-1, 1975), scaled to 1 at q = core: 0 in the middle, falling
// as 1 / q outside, and smooth. A scale that differs between axes stretches where a field is, not the speeds.
//
// A strand takes the wind at its root: the direction of v is what it turns towards, and response(|v|) its
// strength. Where wind.over names ground, v starts as the wind over it (ground_air.h), half as high above
// the root as the strand rises, or a tenth of its reach if that is more. Noise and gusts are carried by the
// mean wind: carried by v, they would be sheared without end. Rays for shelter go upwind of the mean wind.
//
// ERROR: in double; the response is stored as a float, off by less than 1e-6 (local_wind_test.cpp). COST:
// about 10 ns a root and field (marram_bench, "field"); a patch outside a field does not pay for it.
#pragma once

#include "core/math/ramp.h"
#include "core/math/transform.h"
#include "core/math/vec.h"
#include "procedural/abi/values.h"
#include "procedural/air/ground_air.h"
#include "procedural/wind/strands.h"

#include <span>
#include <vector>

namespace marram {

struct PlacedField {
    bool box = false; // else a sphere
    bool replaces = false;
    KeyedTransform transform;
    Vec3d velocity = Vec3d::Zero(); // m/s, in the field's axes
    double swirl = 0.0, pull = 0.0; // m/s
    double core = 0.3;              // share of the field's size, > 0
    double weight = 1.0;            // 0 ... 1
    Ramp ramp;                      // from the centre (0) to the surface (1)
    std::string location{};         // in the scene, for messages
};

// Parameters of [wind] that start with "field[].".
std::span<const MarramParam> field_params();

// Reads values named "wind.field[0]....", ... Throws SceneFault.
std::vector<PlacedField> read_fields(const Values& values);

// Upper bound of what the field adds to the speed, m/s.
double max_added_speed(const PlacedField& field);

// A field at one time.
struct FieldAt {
    const PlacedField* field;
    Vec3d center;
    Eigen::Matrix3d to_unit; // M
    Eigen::Matrix3d axes;    // R: unit columns
    Vec3d lower, upper;      // bounds in world space
};
// Without those of no volume or no weight. `fields` must outlive the result.
std::vector<FieldAt> fields_at(std::span<const PlacedField> fields, double frame);

// Whether its bounds meet the box, in metres, at some time within frames [first, last]: each frame is
// tried, or 1000 times of a longer shot, so one that flies through between two is missed. For warnings.
bool field_touches(const PlacedField& field, const Vec2d& frames, const Eigen::AlignedBox3d& box);

struct LocalWind {
    Vec3d direction; // of the mean wind
    double speed;
    const Ramp& response;
    std::span<const FieldAt> fields;
    GroundAir::At ground{}; // over which it blows, if any: fields change what the ground has made of it
    SpeedHeight reference{};
    bool shielded = false; // rays find shelter, too
};
// Sets strands.wind_direction, wind_speed and wind_response, from the roots of strands.rest; and, with
// `shielded` and ground, strands.wind_unsheltered.
void local_wind(const LocalWind& wind, Strands& strands);

} // namespace marram
