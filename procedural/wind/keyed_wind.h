// SPDX-License-Identifier: Apache-2.0
// Winds whose numbers have keys. `Wind` then holds, of each such
// number, the key that matters most (below), so that what is decided for all times is on the safe side;
// wind_at() gives the wind at one time.
//
// To make a parameter of [wind] keyable: param::keyable() where it is declared, and a row in keyed_wind.cpp.
#pragma once

#include "procedural/abi/values.h"
#include "procedural/wind/air_path.h"
#include "procedural/wind/wind.h"

#include <string>
#include <vector>

namespace marram {

struct KeyedWind {
    struct Track {
        std::string name; // "wind.speed"
        const struct KeyableParam* param;
        size_t control; // index of the gust control that it belongs to
        Keyframes keys;
        std::string text; // interpolation of a ramp
    };
    std::vector<Track> tracks;
    AirPath air;       // noise and gusts move with it
    AirPath course;    // the same at 1 m/s: of gusts that have a speed of their own
    AirPath evolution; // x: cells of noise
};

// Sets wind.keys if values have keys, and the numbers of `wind` that have them: to the key with the
// strongest wind, the largest number, or of jiggle the longest memory. Throws SceneFault.
void read_keys(const Values& values, Wind& wind);

// What gusts go with.
GustCarrier gust_carrier(const Wind& wind);

// The wind at a frame. Costs a copy: about 2 us.
Wind wind_at(const Wind& wind, double frame);

} // namespace marram
