// SPDX-License-Identifier: Apache-2.0
// Finds how strongly strands must be turned, over the wind's speed and along them, to stand as given.
#pragma once

#include "core/math/vec.h"

#include <functional>
#include <vector>

namespace marram {

using Directions = std::vector<Vec3d>; // [segment], unit: of all strands, one after the other

struct BendTargets {
    std::vector<Directions> directions; // [speed], of ascending speeds above 0
    std::vector<double> weights;        // [segment], sum 1: its share of the strands' length
    size_t knots = 0;                   // of the profile along a strand
};

// The directions of the same strands, if they are turned with these strengths at the knots, at least 0.
using Bend = std::function<Directions(const std::vector<double>& at_knots)>;

struct BendFit {
    std::vector<double> strengths; // [speed], at least 0, ascending or equal
    std::vector<double> profile;   // [knot], at least 0, the largest 1
    double residual = 0.0;         // root mean square distance of unit vectors
    int steps = 0;                 // that lowered it
};

// Minimises the squared distance of bend(strength of a speed * profile) from the directions at that speed.
// See bend_fit.cpp for the method. `enough`: asked before each step, ends the search. Cost: a call of
// bend() for each speed and knot, for each step.
BendFit fit_bend(const BendTargets& targets, const Bend& bend, const std::function<bool()>& enough);

// The knots (position, value) of a piecewise linear curve that are needed to keep it within `tolerance` of
// its values.
std::vector<Vec2d> fewer_knots(const std::vector<Vec2d>& knots, double tolerance);

} // namespace marram
