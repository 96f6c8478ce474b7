// SPDX-License-Identifier: Apache-2.0
// A few strands of a groom, blown in more than one way, tell where a dial has to stand for the frame's tolerance. What is looked at
// is what 99 strands in 100 stay below, times a spare quarter.
#pragma once

#include "procedural/groom/description.h"
#include "procedural/groom/roots.h"
#include "procedural/groom/strand_shape.h"
#include "procedural/wind/chain.h"

#include <functional>
#include <span>

namespace marram {

struct PilotGroom {
    const Groom& groom;
    const Wind& wind;
    const MarramFrame& frame;
    const MarramMesh& skin;
    std::span<const Root> roots;
    Surface bind;
    std::optional<Guided> guided{}; // its blends are those of the roots
    double size = 1.0;              // as much larger its strands are looked at: as the largest instance is
};

struct Choice {
    double value;
    bool enough; // false: the tolerance asks for more than there is
};

// The fewest CVs, 3 ... 1000, with which the polygons of strands in the whole of the wind, without gusts or shelter, end within the
// tolerance of those with CVs beyond number, and widths too. From 2, 4, 8, 16 and 32 segments against 64: the distance falls with
// their number. Curls and frizz get at least six segments a turn, and are looked at from there on. At three moments fixed for the
// shot: depends on the description and the tolerance, not on the frame. Cost: 512 strands of 132 CVs.
Choice cvs_for(const PilotGroom& pilot);

// Strands of one CV count that swing on a skin that rests.
struct JigglePilot {
    const Wind& wind;
    const MarramFrame& frame;
    const MarramMesh* skin; // nullptr: they grow on nothing
    const Ramp& envelope;
    MarramBasis basis;
    double length;            // no strand is longer
    double tolerance;         // metres
    Eigen::AlignedBox3d rest; // holds every rest CV of all strands
    size_t count;
    int cvs;
    bool irregular;                                         // as Strands::irregular
    std::function<void(const Wind& wind, Strands&)> expand; // rest strands; resizes
};

JigglePilot jiggle_pilot(const PilotGroom& pilot);

// Frames between samples of the past, 1/64, 1/32, ... 2. Steps of 2, 1 and 1/2 are compared with 1/4; finer ones follow from the
// last, with the square of the step. No more than 1/2 where jiggle has a start_frame, which is rounded down to a whole number of
// steps, and no finer than a window of 2048 samples allows. On a skin that moves: 1/2, since its motion, which is keyed at
// whole frames as a rule, would have to be asked for time and again. Cost: 96 strands over some 8 samples a frame.
Choice jiggle_step_for(const JigglePilot& pilot, bool skin_moves);

inline constexpr double usual_jiggle_step = 0.5;

} // namespace marram
