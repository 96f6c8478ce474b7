// SPDX-License-Identifier: Apache-2.0
// Wind histories and their drift potential.
//
// Compass: +x is east and -z is north, so a map seen from above has north up. Meteorology gives the direction
// wind comes *from*, clockwise from north. A SandWind has the direction wind blows *to*: for the angle d that
// is (-sin d, cos d) in (x, z).
//
// Shear velocity for the speed U at height z over ground of aerodynamic roughness z0, in neutral air: u* =
// kappa U / ln(z / z0), kappa = 0.4. z0 is the roughness with sand in the air, about 1 mm (on a dry flat bed
// it is 1/30 of the grain diameter).
//
// Chaotic winds: entry n of length `seconds` uses random numbers from hash(seed, n): a Box-Muller normal
// deviate for the direction, and u* = scale (-ln v)^(1 / shape), scale = mean / Gamma(1 + 1 / shape), a
// Weibull distribution with that mean. There is no state.
//
// Drift potential (DP): the time mean of the saturated flux over level ground, kg / (m s). RDP is the
// magnitude of the mean flux vector. Fryberger's DP (S. Fryberger, "Dune forms and wind regime", USGS Prof.
// Paper 1052, 1979) is the mean of U^2 (U - U_t) over all entries times 100, U in knots at 10 m, U_t = 11.66
// knots (6 m/s) by default. In his units below 200 is low energy, above 400 high. RDP / DP is 1 for one
// direction and 0 for winds that cancel.
#include "procedural/terrain/solver/winds.h"

#include "core/math/hash.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace marram {
namespace {

constexpr double winds_karman = 0.4;
constexpr double winds_knot = 1852.0 / 3600.0; // m/s

// Repeating winds. `ends`: end times, ascending; the last one is the period.
WindHistory winds_periodic(std::vector<SandWind> winds, std::vector<double> ends) {
    if (winds.empty()) return steady_wind({});
    return [winds = std::move(winds), ends = std::move(ends)](double time) -> WindSpan {
        const double period = ends.back();
        double turn = std::floor(time / period);
        const double phase = std::max(time - turn * period, 0.0);
        size_t k = size_t(std::upper_bound(ends.begin(), ends.end(), phase) - ends.begin());
        if (k == ends.size()) k = 0, turn += 1.0;
        // Rounding can make an entry end exactly at `time`; the next entry then applies.
        while (!(turn * period + ends[k] > time))
            if (++k == ends.size()) k = 0, turn += 1.0;
        return {winds[k], turn * period + ends[k]};
    };
}

} // namespace

SandWind wind_from(double degrees, double shear_velocity) {
    const double d = degrees * degree;
    return {-std::sin(d), std::cos(d), shear_velocity};
}

double shear_velocity_of(double speed, double height, double z0) {
    return winds_karman * speed / std::log(height / z0);
}
double wind_speed_of(double shear_velocity, double height, double z0) {
    return shear_velocity * std::log(height / z0) / winds_karman;
}

WindHistory steady_wind(const SandWind& wind) {
    return [wind](double) -> WindSpan { return {wind, infinity}; };
}

WindHistory wind_sequence(std::vector<TimedWind> winds) {
    std::vector<SandWind> list;
    std::vector<double> ends;
    double end = 0.0;
    for (const TimedWind& timed : winds)
        if (timed.seconds > 0.0) list.push_back(timed.wind), ends.push_back(end += timed.seconds);
    return winds_periodic(std::move(list), std::move(ends));
}

WindHistory chaotic_wind(const ChaoticWind& chaos) {
    const double scale = chaos.mean / std::tgamma(1.0 + 1.0 / chaos.shape);
    return [chaos, scale](double time) -> WindSpan {
        double n = std::max(std::floor(time / chaos.seconds), 0.0);
        while (!((n + 1.0) * chaos.seconds > time)) n += 1.0;
        const uint64_t draw = hash(chaos.seed, uint64_t(n));
        const double u = 1.0 - unit_double(hash(draw, 1)), v = unit_double(hash(draw, 2));
        const double angle =
            chaos.towards + chaos.spread * std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * pi * v);
        const double w = 1.0 - unit_double(hash(draw, 3));
        const double shear = scale * std::pow(-std::log(w), 1.0 / chaos.shape);
        return {{std::cos(angle), std::sin(angle), shear}, (n + 1.0) * chaos.seconds};
    };
}

double last_duration(const WindRecord& record) {
    const size_t count = record.time.size();
    return count > 1 ? record.time[count - 1] - record.time[count - 2] : seconds_per_hour;
}

namespace {

// Sums over entries that become one.
struct WindSum {
    double seconds = 0.0;
    Vec2d sand{0, 0}, air{0, 0}; // integrals of flux and shear velocity
    size_t entries = 0;

    void add(const TimedWind& timed, const SandPhysics& physics) {
        const Vec2d towards(timed.wind.towards_x, timed.wind.towards_z);
        seconds += timed.seconds;
        sand += physics.saturated_flux(timed.wind.shear_velocity) * timed.seconds * towards;
        air += timed.wind.shear_velocity * timed.seconds * towards;
        ++entries;
    }
    TimedWind merged(const SandPhysics& physics) const {
        const bool moves = sand.norm() > 0.0;
        const Vec2d& sum = moves ? sand : air;
        const double size = sum.norm();
        if (!(size > 0.0) || !(seconds > 0.0)) return {{}, seconds};
        const double shear = moves ? physics.shear_velocity_of_flux(size / seconds)
                                   : std::min(size / seconds, physics.threshold);
        return {{sum.x() / size, sum.y() / size, shear}, seconds};
    }
};

} // namespace

std::vector<TimedWind> winds_of(const WindRecord& record) {
    std::vector<TimedWind> winds;
    for (size_t k = 0; k < record.time.size(); ++k)
        winds.push_back(
            {wind_from(record.from[k], shear_velocity_of(record.speed[k], 10.0, record.z0)),
             k + 1 < record.time.size() ? record.time[k + 1] - record.time[k] : last_duration(record)});
    return winds;
}

std::vector<TimedWind> merged_winds(std::span<const TimedWind> winds, double shortest,
                                    const SandPhysics& physics) {
    std::vector<TimedWind> merged;
    WindSum sum;
    for (const TimedWind& timed : winds) {
        if (sum.entries == 0 && timed.seconds >= shortest) {
            merged.push_back(timed);
            continue;
        }
        sum.add(timed, physics);
        if (sum.seconds < shortest) continue;
        merged.push_back(sum.merged(physics));
        sum = {};
    }
    if (sum.entries == 0) return merged;
    if (!merged.empty()) { // the rest of the record belongs to its last wind
        sum.add(merged.back(), physics);
        merged.pop_back();
    }
    merged.push_back(sum.merged(physics));
    return merged;
}

WindHistory recorded_wind(const WindRecord& record) {
    std::vector<SandWind> winds;
    std::vector<double> ends;
    const size_t count = record.time.size();
    for (size_t k = 0; k < count; ++k) {
        winds.push_back(wind_from(record.from[k], shear_velocity_of(record.speed[k], 10.0, record.z0)));
        ends.push_back((k + 1 < count ? record.time[k + 1] : record.time[k] + last_duration(record)) -
                       record.time[0]);
    }
    return winds_periodic(std::move(winds), std::move(ends));
}

DriftPotential drift_potential(std::span<const TimedWind> winds, const SandPhysics& physics) {
    DriftPotential drift;
    double seconds = 0.0, x = 0.0, z = 0.0;
    for (const TimedWind& timed : winds) {
        const double q = physics.saturated_flux(timed.wind.shear_velocity) * timed.seconds;
        seconds += timed.seconds;
        drift.dp += q, x += q * timed.wind.towards_x, z += q * timed.wind.towards_z;
    }
    if (!(seconds > 0.0)) return {};
    drift.dp /= seconds;
    const double size = std::hypot(x, z);
    drift.rdp = size / seconds;
    if (size > 0.0) drift.towards_x = x / size, drift.towards_z = z / size;
    return drift;
}

DriftPotential fryberger_drift(const WindRecord& record, double threshold) {
    DriftPotential drift;
    double x = 0.0, z = 0.0;
    for (size_t k = 0; k < record.speed.size(); ++k) {
        const double knots = record.speed[k] / winds_knot;
        const double q =
            100.0 * knots * knots * std::max(knots - threshold, 0.0) / double(record.speed.size());
        const SandWind wind = wind_from(record.from[k], 1.0);
        drift.dp += q, x += q * wind.towards_x, z += q * wind.towards_z;
    }
    drift.rdp = std::hypot(x, z);
    if (drift.rdp > 0.0) drift.towards_x = x / drift.rdp, drift.towards_z = z / drift.rdp;
    return drift;
}

std::vector<TimedWind> winds_between(const WindHistory& history, double from, double to) {
    std::vector<TimedWind> winds;
    for (double time = from; time < to;) {
        const WindSpan span = history(time);
        const double until = std::min(span.until, to);
        winds.push_back({span.wind, until - time});
        time = until;
    }
    return winds;
}

std::string drift_text(const DriftPotential& drift, const char* unit) {
    double to = std::atan2(drift.towards_x, -drift.towards_z) / degree; // clockwise from north
    if (to < 0.0) to += 360.0;
    char line[160];
    std::snprintf(line, sizeof line, "DP %.4g %s, RDP %.4g %s towards %.0f deg, RDP/DP %.3f", drift.dp, unit,
                  drift.rdp, unit, to, drift.ratio());
    return line;
}

} // namespace marram
