// SPDX-License-Identifier: Apache-2.0
// Winds over time, and what they could move. The page is in winds.cpp.
#pragma once

#include "procedural/terrain/solver/transport.h"

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace marram {

inline constexpr double seconds_an_hour = 3600.0;
inline constexpr double seconds_a_year = 365.25 * 86400.0;

// A wind and the time at which it ends, seconds.
struct WindSpan {
    SandWind wind;
    double until = infinity;
};

// The wind at a time (seconds from 0 on): a pure function.
using WindHistory = std::function<WindSpan(double)>;

// Compass of a scene: +x east, -z north. A direction *from* which wind blows, clockwise from north, degrees.
SandWind wind_from(double degrees, double shear_velocity);
// Logarithmic law: the shear velocity of a wind of `speed` at `height` over ground of roughness `z0`, metres.
double shear_velocity_of(double speed, double height = 10.0, double z0 = 1e-3);
double wind_speed_of(double shear_velocity, double height = 10.0, double z0 = 1e-3);

WindHistory steady_wind(const SandWind& wind);

struct TimedWind {
    SandWind wind;
    double seconds = 0.0;
};
// One after the other, again and again. Those of no length are left out.
WindHistory wind_sequence(std::vector<TimedWind> winds);

// Directions and strengths drawn anew every `seconds`: towards `towards` (radians from +x to +z) with a normal distribution of `spread`, a
// Weibull distribution of the shear velocity.
struct ChaoticWind {
    double towards = 0.0, spread = 0.5; // radians
    double mean = 0.3, shape = 2.0;     // of the shear velocity, m/s; shape of Weibull's distribution
    double seconds = 6.0 * seconds_an_hour;
    uint64_t seed = 0;
};
WindHistory chaotic_wind(const ChaoticWind& chaos);

// Measured: each entry holds until the next one's time, the last one as long as the one before it; then from the start again.
struct WindRecord {
    std::vector<double> time;  // seconds, ascending
    std::vector<double> speed; // m/s at 10 m
    std::vector<double> from;  // degrees clockwise from north
    double z0 = 1e-3;          // metres
};
// What is wrong with a record, or nothing.
std::string wind_record_problem(const WindRecord& record);
WindHistory recorded_wind(const WindRecord& record);

// Drift potential: mean of the saturated flux, and of its vector.
struct DriftPotential {
    double dp = 0.0, rdp = 0.0;              // kg / (m s)
    double towards_x = 0.0, towards_z = 0.0; // of the resultant; 0 where it is 0
    double ratio() const { return dp > 0.0 ? rdp / dp : 0.0; }
};
DriftPotential drift_potential(std::span<const TimedWind> winds, const SandPhysics& physics);
// Fryberger's, in his vector units (knots).
DriftPotential fryberger_drift(const WindRecord& record, double threshold = 11.66);
// Winds of a history from `from` to `to`, seconds.
std::vector<TimedWind> winds_between(const WindHistory& history, double from, double to);
std::string drift_text(const DriftPotential& drift, const char* unit);

} // namespace marram
