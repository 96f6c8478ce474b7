// SPDX-License-Identifier: Apache-2.0
// Winds whose numbers have keys. CV counts, rays, steps and windows are chosen for all frames, so `Wind`
// itself then holds, of each such number, the key that asks for most (below); wind_at() gives the wind at
// one time.
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
        size_t element; // of a list, such as gusts.control: which of its tables
        Keyframes keys;
        std::string ramp_interpolation; // of a ramp, else ""
    };
    std::vector<Track> tracks;
    AirPath air;           // of the mean wind: what carries noise and gusts
    AirPath at_unit_speed; // the same at 1 m/s: times the speed of a gust that has one of its own
    AirPath evolution;     // x: cells of noise a second, integrated likewise; y and z are 0
};

// Sets wind.keys if values have keys, and the numbers of `wind` that have them: response to one that it
// never exceeds, speed to that with the largest response, jiggle to the key with the longest memory,
// direction to the first, others to the largest number. Of a wind that bends blades, response and
// global_rotate stay. Throws SceneFault.
void read_keys(const Values& values, Wind& wind);

// The path that gusts take, of the keys if the wind has any.
GustCarrier gust_carrier(const Wind& wind);

// The wind at a frame. Costs a copy of the Wind: to be called once a time, not once a patch.
Wind wind_at(const Wind& wind, double frame);

} // namespace marram
