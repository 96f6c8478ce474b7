// SPDX-License-Identifier: Apache-2.0
// Wind histories and their drift potential. See winds.cpp for the formulas.
#pragma once

#include "core/math/vec.h"
#include "procedural/terrain/solver/transport.h"

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace marram {

inline constexpr double seconds_per_hour = 3600.0;
inline constexpr double seconds_per_year = 365.25 * 86400.0;

// A wind and its end time, seconds.
struct WindSpan {
    SandWind wind;
    double until = infinity;
};

// The wind at a time (seconds, from 0). Must be a pure function.
using WindHistory = std::function<WindSpan(double)>;

// The wind *from* a compass direction, degrees clockwise from north. In a scene +x is east and -z north.
SandWind wind_from(double degrees, double shear_velocity);
// Logarithmic law: shear velocity of a wind with `speed` at `height` over ground of roughness `z0`; metres,
// m/s.
double shear_velocity_of(double speed, double height = 10.0, double z0 = 1e-3);
double wind_speed_of(double shear_velocity, double height = 10.0, double z0 = 1e-3);

WindHistory steady_wind(const SandWind& wind);

struct TimedWind {
    SandWind wind;
    double seconds = 0.0;
};
// The winds in turn, repeated. Skips winds of zero duration.
WindHistory wind_sequence(std::vector<TimedWind> winds);

// Direction and strength are redrawn every `seconds`. Direction: normal distribution about `towards` (radians
// from +x to +z) with standard deviation `spread`. Shear velocity: Weibull distribution.
struct ChaoticWind {
    double towards = 0.0, spread = 0.5; // radians
    double mean = 0.3, shape = 2.0;     // Weibull distribution of the shear velocity; mean in m/s
    double seconds = 6.0 * seconds_per_hour;
    uint64_t seed = 0;
};
WindHistory chaotic_wind(const ChaoticWind& chaos);

// A measured wind. Each entry lasts until the next; the last one lasts as long as the one before. Then it
// repeats.
struct WindRecord {
    std::vector<double> time;  // seconds, ascending
    std::vector<double> speed; // m/s at 10 m
    std::vector<double> from;  // degrees clockwise from north
    double z0 = 1e-3;          // metres
};
double
last_duration(const WindRecord& record); // seconds that the last entry blows: as long as the one before
WindHistory recorded_wind(const WindRecord& record);

// The entries of a record in turn.
std::vector<TimedWind> winds_of(const WindRecord& record);
// Entries that last less than `shortest` seconds are merged with those after them until they do. What
// replaces them moves as much sand, as a vector, in the same time; without any, it is their mean wind.
std::vector<TimedWind> merged_winds(std::span<const TimedWind> winds, double shortest,
                                    const SandPhysics& physics);

// How the wind differs from place to place, relative to the wind of the moment; per sample (i, j) at j * nx +
// i. Empty: nowhere.
struct WindField {
    std::vector<float> turn;     // radians, from +x towards +z; at most max_turn to either side
    std::vector<float> strength; // factor of the shear velocity, 0 to 10
    // The wind of the moment crosses rows at up to 45 degrees to their normal, the local one at up to 75; the
    // march does not turn the flux by more than 79.
    static constexpr double max_turn = 30.0 * degree;
    bool empty() const { return turn.empty(); }
};

// Drift potential: mean of the saturated flux (dp), and magnitude of its mean vector (rdp).
struct DriftPotential {
    double dp = 0.0, rdp = 0.0;              // kg / (m s)
    double towards_x = 0.0, towards_z = 0.0; // unit vector of the resultant; 0 if rdp is 0
    double ratio() const { return dp > 0.0 ? rdp / dp : 0.0; }
};
DriftPotential drift_potential(std::span<const TimedWind> winds, const SandPhysics& physics);
// Fryberger's drift potential, in his vector units (knots).
DriftPotential fryberger_drift(const WindRecord& record, double threshold = 11.66);
// The winds of a history from `from` to `to`, seconds.
std::vector<TimedWind> winds_between(const WindHistory& history, double from, double to);
std::string drift_text(const DriftPotential& drift, const char* unit);

} // namespace marram
