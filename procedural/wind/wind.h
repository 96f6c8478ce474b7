// SPDX-License-Identifier: Apache-2.0
// What a scene says of its one wind.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/values.h"
#include "procedural/wind/collide.h"
#include "procedural/wind/gusts.h"
#include "procedural/wind/jiggle.h"
#include "procedural/wind/noise.h"
#include "procedural/wind/shield.h"

#include <optional>
#include <span>

namespace marram {

struct Wind {
    Vec3d direction = Vec3d::UnitX(); // where the air goes to, unit
    double speed = 0.0;               // m/s
    double calm = 1.0;                // wind between gusts
    std::optional<Gusts> gusts;
    Ramp response; // speed in m/s -> share of the envelope; response(0) = 0
    double global_rotate = 1.0;
    Ramp ramp_rotate;             // over u, root to tip
    double waviness = 1.0;        // noise coordinate advance along w per arc length
    int reference_segments = 0;   // segments that a rotation factor belongs to; 0: as many as the strand has
    double noise_amplitude = 0.0; // relative to the unit wind direction
    FractalNoise noise;
    double evolution = 0.0;                  // lattice cells a second along the fourth dimension
    bool rest_anchored = false;              // noise is sampled at the root's place at bind_frame
    bool loops = false;                      // the noise of loop_end is that of loop_begin
    double loop_begin = 0.0, loop_end = 0.0; // frames
    // Each stage is there when the scene asks for it.
    std::optional<Shielding> shielding;
    std::optional<Jiggle> jiggle; // strands swing into their pose
    std::optional<Collision> collision;
};

// Parameters of [wind], which every procedural receives as "wind.<name>".
std::span<const MarramParam> wind_params();

// Throws SceneFault for what cannot be checked value by value.
Wind read_wind(const Values& values);

// response(speed), in [0, 1]: what the wind's speed leaves of the envelope.
double wind_response(const Wind& wind);

// The greatest share of its angle to the wind that a segment turns by, 0 ... 1.
double most_turn(const Wind& wind);

// How many of the finest octaves no more than move 99 in 100 of strands no longer than `length` by `tolerance` metres together:
// a segment's direction is off by no more than the noise that it turns towards, relative to the wind's 1, and the noise is weaker
// than 0.9 at 99 points in 100 (rms 0.27 a component). Jiggle may swing strands farther, by its resonance.
int octaves_too_fine(const Wind& wind, double length, double tolerance);

// False: no strand bends in this wind, whatever its gusts.
bool wind_bends(const Wind& wind);

// False: a strand in this wind stands still in time (it may still be bent).
bool wind_moves(const Wind& wind);

} // namespace marram
