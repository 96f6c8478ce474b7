// SPDX-License-Identifier: Apache-2.0
// The wind of a scene: the parameters of [wind].
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"
#include "procedural/noise/noise.h"
#include "procedural/wind/collision/collide.h"
#include "procedural/wind/gusts.h"
#include "procedural/wind/jiggle.h"
#include "procedural/wind/local_wind.h"
#include "procedural/wind/shield.h"

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

struct KeyedWind; // keyed_wind.h

// A mesh whose shape makes the wind faster and slower (ground_air.h).
struct Over {
    std::string mesh, place; // place: in the scene, for messages
    SpeedHeight speed;
};

struct Wind {
    Vec3d direction = Vec3d::UnitX(); // unit; points downwind
    double speed = 0.0;               // m/s
    double calm = 1.0;                // background wind, 0 ... 1
    std::optional<Gusts> gusts;
    Ramp response; // speed in m/s -> factor of the envelope, 0 ... 1; response(0) = 0
    double global_rotate = 1.0;
    Ramp ramp_rotate;             // over u, root to tip
    double waviness = 1.0;        // advance of the noise coordinate along the wind, per arc length
    int reference_segments = 0;   // that the turn factor is meant for; 0: as many as the strand has
    double noise_amplitude = 0.0; // relative to the unit wind direction
    FractalNoise noise;
    double evolution = 0.0;                  // lattice cells a second along the fourth dimension
    bool noise_at_bind_frame = false;        // noise is sampled at the root's position at bind_frame
    bool loops = false;                      // the noise at loop_end equals the noise at loop_begin
    double loop_begin = 0.0, loop_end = 0.0; // frames
    // Optional stages, set if the scene uses them.
    std::vector<PlacedField> fields; // where the wind differs from place to place
    bool fields_at_cvs = false;      // each CV feels them where it is, not its strand's root
    std::optional<Over> over;        // the ground that it blows over
    double air_density = 1.225;      // kg/m^3
    bool bends_blades = false;       // response is the speed (blade.h)
    std::optional<Shielding> shielding;
    std::optional<Jiggle> jiggle; // damped oscillation about the bent pose
    std::optional<Collision> collision;
    std::shared_ptr<const KeyedWind> keys; // nullptr: the wind has the same numbers at all times
    std::optional<Ramp> point_envelope;    // of the groom, over u, if it has keys
};

// Parameters of [wind]. Every procedural receives them as "wind.<name>".
std::span<const MarramParam> wind_params();

// How they bend strands, as text for the manual; README.md and bend.cpp have more.
extern const char* const wind_help;

// Appends wind.direction and wind.speed, which then cannot have keys: for procedurals whose wind is the
// same at all times.
void add_constant_wind(std::vector<MarramParam>& list);

// False: a default. Defaults have the place of their table in common, or none.
bool is_given(const Values& values, const std::string& name);

// Throws SceneFault for errors that the range checks of single values cannot find. `blade_frequency`,
// Hz: the wind bends blades, which swing at it if jiggle is asked for without a frequency.
Wind read_wind(const Values& values, std::optional<double> blade_frequency = {});

// Makes it bend blades: its response is its speed, and nothing else scales its turn.
void set_blade_wind(Wind& wind);
inline constexpr double blade_response_speed = 1000.0; // m/s, at response 1

// response(speed), clamped to [0, 1]: the envelope's factor for this wind speed.
double wind_response(const Wind& wind);
// The largest response that fields may make of it.
double max_response(const Wind& wind);

// The largest fraction of its angle to the wind that any segment turns by, 0 ... 1.
double max_turn_fraction(const Wind& wind);

// Number of the finest octaves that can be left out: for 99 % of the strands up to `length` metres long, all
// of them together move a CV by at most `tolerance` metres. A segment's direction changes by at most the
// noise left out, relative to the wind's 1; one octave is below 0.9 at 99 % of all points (rms 0.27 a
// component). The resonance of jiggle is included.
int negligible_octaves(const Wind& wind, double length, double tolerance);

// False: this wind bends no strand.
bool wind_bends(const Wind& wind);

// False: the bend does not change with time (strands may still be bent).
bool wind_moves(const Wind& wind);

} // namespace marram
