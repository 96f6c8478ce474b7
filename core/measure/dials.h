// SPDX-License-Identifier: Apache-2.0
// The dials that trade time for error, and how each is turned. A dial is a list of settings, each a few changes to the scene; what a
// scene does not use is left out and said.
//
// To add a dial: give a parameter its `sweep` where it is declared, in a procedural; what needs more than its values has a function in
// dials.cpp, and a line in dials_of().
#pragma once

#include "core/shot/shot.h"
#include "core/shot/stats.h"

#include <string>
#include <vector>

namespace marram {

struct DialSetting {
    std::string label;
    std::vector<std::string> changes; // key=value
    bool own = false;                 // what the scene has
    uint32_t samples = 0;             // a pixel, of an image's dial
};

// What its error is measured on, always against the reference setting.
enum class DialError {
    pose,    // CVs, as shares of the strand's length
    motion,  // CVs over the shutter, in pixels of the film
    surface, // heights of the meshes that procedurals make, in metres
    view,    // the same of the meshes that the camera sees in their place, in pixels at their distance
    image    // pixels, relative to the reference's mean
};

struct Dial {
    std::string name;    // "contact"
    std::string explain; // one sentence: what is turned, what the reference is
    std::string time;    // what is timed: "collide"
    DialError error = DialError::pose;
    bool counts_crossing = false; // strands that a mesh crosses
    std::vector<DialSetting> settings;
    size_t reference = 0;
    double weight = 1.0; // share of the time that it gets
    // Where the tolerance can turn it: how the error goes with the setting's number, and in words. Null: it cannot.
    double (*law)(double) = nullptr;
    std::string law_words{};
};

double seconds_of(const Dial& dial, const FrameStats& stats);

struct DialList {
    std::vector<Dial> dials;
    std::vector<std::string> left_out; // "jiggle: no strand jiggles"
};
DialList dials_of(const Shot& shot);

// Changes that leave about this share of the strands.
std::vector<std::string> thinned(const Shot& shot, double share);

} // namespace marram
