// SPDX-License-Identifier: Apache-2.0
// Strands turned by dials against the same strands bent as blades: how far apart they are over the wind's
// speed, and the dials that bring them closest. See bend.cpp for what is compared.
#pragma once

#include "core/measure/bend_fit.h"
#include "core/shot/shot.h"

#include <string>
#include <vector>

namespace marram {

struct Session;
struct Measurement;

// Angles between directions of segments, in degrees; each segment counts by its length.
struct BendError {
    double median = 0.0, most = 0.0; // most: 95 % are below
};

struct BendRow {
    double from = 0.0, to = 0.0; // a speed, m/s (both the same); or a part of the strands, root 0 to tip 1
    BendError turned;            // of the blades, from the groomed shape
    BendError before, after;     // of the dials, from the blades: the scene's own dials, and the fitted ones
};

struct BendResult {
    std::string groom;
    size_t strands = 0;
    uint64_t unsolved = 0; // blades, most at any speed
    double max_speed = 0.0;
    std::vector<BendRow> by_speed, by_arc; // by_arc: over all speeds above 0
    BendError before, after;               // over all speeds above 0
    std::vector<std::string> dials;        // of the fit: lines of [wind]
};

// Share of the time that this takes, as Dial::weight.
double bend_weight(const Shot& shot);

// Adds the results of all grooms of blades to the measurement, or why there are none. `seconds`: what it
// may take.
void measure_bend(const Shot& shot, const Session& session, double seconds, Measurement& measurement);

// Degrees.
BendError bend_error(const Directions& a, const Directions& b, const std::vector<double>& weights);

} // namespace marram
