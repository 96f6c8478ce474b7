// SPDX-License-Identifier: Apache-2.0
// A wind that was measured, from a table (MARRAM_TABLE) whose columns are found by name.
#pragma once

#include "core/math/keyframes.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <string>
#include <vector>

namespace marram {

struct MeasuredWind {
    std::vector<double> time;  // seconds; of the table's floats
    std::vector<double> speed; // m/s
    std::vector<double> from;  // degrees clockwise from north (-z) to where it comes from
    double time_unit = 3600.0; // seconds in a unit of the table's times
};

// Columns may be called time, t or hours; speed, wind_speed, ws, u or u10; direction, wind_direction, dir
// or wd; each with its unit in brackets, "speed (km/h)": h, s, min or d (default h); m/s, km/h, kn or mph
// (default m/s); deg or rad (default deg). Throws SceneFault with `id` and `place` for what it does not
// find or know, and for fewer than two rows, numbers out of range and times that do not ascend.
MeasuredWind read_measured_wind(const MarramValue& table, const char* id, const std::string& place);

// The same as keys of speed and of the unit direction in which it blows, with the first row at `first` and
// the last one at `last`; between rows, also far apart, the wind is interpolated. Turns of more than 90
// degrees get a key half way, so that they are even; from the opposite side the wind turns clockwise.
struct MeasuredKeys {
    Keyframes speeds, directions;
};
MeasuredKeys keys_of(const MeasuredWind& wind, double first, double last);

} // namespace marram
