// SPDX-License-Identifier: Apache-2.0
// The dials of `marram measure`: parameters that trade time for error. A dial is a list of settings, each a
// few changes to the scene. Dials of features that a scene does not use are left out, with the reason.
//
// To add a dial: give a parameter of a procedural its `sweep` where it is declared. A dial that needs more
// than a list of values gets a function: in strand_dials.cpp if it is about strands, else in dials.cpp.
#pragma once

#include "core/shot/shot.h"
#include "core/shot/stats.h"

#include <string>
#include <vector>

namespace marram {

struct DialSetting {
    std::string label;
    std::vector<std::string> changes; // key=value
    bool own = false;                 // the scene's own setting
    uint32_t samples = 0;             // per pixel, for the dial of the picture
    double number = 0.0;              // value of a setting that is a number
    bool by_tolerance = false;        // the tolerance chooses it
};

// How the error of a setting is measured, against the reference setting.
enum class DialError {
    pose,      // CVs, as a fraction of the strand's length
    motion,    // CVs over the shutter, in pixels of the film
    surface,   // heights or shapes of growth surfaces (meshes made by procedurals), in metres
    attribute, // the first attribute of growth surfaces of one shape, relative to the reference's
    view,      // heights of render meshes, in pixels at their distance
    image      // pixel values, relative to the reference's mean
};

struct Dial {
    std::string name;    // "contact"
    std::string explain; // what is varied, and what the reference is
    std::string time;    // what is timed: "collide"
    DialError error = DialError::pose;
    bool counts_crossing = false; // count strands that cross a mesh
    std::vector<DialSetting> settings;
    size_t reference = 0;
    double weight = 1.0; // relative share of the time budget
    // Changes that take collision out of the scene. Contact branches: a strand that touches a mesh may pass
    // it on either side, whatever small error it had before. So errors of poses are measured without contact,
    // and the share of strands that contact then leaves farther than the tolerance from the reference is a
    // column of its own. Empty: errors are those of the scene as it is.
    std::vector<std::string> without_contact{};
    // If the tolerance can choose the setting: the error as a function of its number, up to a factor, and the
    // same in words. nullptr: it cannot.
    double (*law)(double) = nullptr;
    std::string law_words{};
};

double seconds_of(const Dial& dial, const FrameStats& stats);

struct DialList {
    std::vector<Dial> dials;
    std::vector<std::string> left_out; // "jiggle: no strand jiggles"
};
DialList dials_of(const Shot& shot);

// Changes to the scene that keep about this share of the strands.
std::vector<std::string> thinned(const Shot& shot, double share);

} // namespace marram
