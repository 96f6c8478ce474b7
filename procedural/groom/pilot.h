// SPDX-License-Identifier: Apache-2.0
// A few strands of a groom, blown in more than one way, tell where a dial has to stand for the frame's tolerance. What is looked at
// is what 99 strands in 100 stay below, times a spare quarter.
#pragma once

#include "procedural/groom/description.h"
#include "procedural/groom/past.h"
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
    uint32_t mesh; // of the frame: the skin
    std::span<const Root> roots;
    Surface bind;
};

// The fewest CVs, 3 ... 513, with which strands in the whole of the wind, without gusts or shelter, at the bind frame, end within the
// tolerance of where they would with CVs beyond number. From 3, 5, 9, 17 and 33 CVs against 65: the distance falls with the
// number of segments. Depends on the description and the tolerance, not on the frame. `enough`: whether they are.
// Cost: 512 strands of 132 CVs.
int cvs_for(const PilotGroom& pilot, bool& enough);

// The longest time between samples of the past, a power of two from 1/64 to 2 frames, that moves strands at the frame's first motion
// sample by no more than the tolerance. From steps of 1 and 1/2: the distance falls with the square of the step. 0 where nothing
// moves, so that nothing swings. Cost: 128 strands, jiggled twice.
MarramStatus jiggle_step_for(const PilotGroom& pilot, double& step);

} // namespace marram
