// SPDX-License-Identifier: Apache-2.0
// Jiggle by integrating the oscillator over the whole history, step by step.
//
// Every component of every CV obeys x'' + 2 zeta omega x' + omega^2 x = omega^2 g(t), with g linear or cubic
// between knots; before the first knot it rests at g's first value. Differentiation gives all derivatives
// from x, x', g, g', g'' and g''': x^(n+2) = -2 zeta omega x^(n+1) - omega^2 x^(n) + omega^2 g^(n), g^(n) =
// 0 for n >= 4, so a step is a Taylor sum. With h omega max(1, 2 zeta) <= 1/4 and 16 terms, the truncation
// error is below 4^-17 / 17! < 1e-24 of the values per step. Only rounding remains, which grows with the
// square root of the number of steps. Cost: 4 omega max(1, 2 zeta) steps per second, CV and component.
//
// Lengths are then restored from root to tip: y_0 is the true root, y_{k+1} = y_k + the rest length along
// x_{k+1} - x_k, with x_k the filtered CV and x_0 the true root, so that the strand lags behind a moving
// root. (A filtered root would shift the whole filtered shape of the strand with it and hide the lag.)
#pragma once

#include "core/math/vec.h"

#include <vector>

namespace marram::oracle {

struct History {
    std::vector<double> times;             // knots in seconds, ascending
    std::vector<std::vector<Vec3d>> poses; // [knot][CV], the same CV count at all knots
    // True: knots are equally spaced, and offsets from the root (CV 0) move along Catmull and Rom's cubics
    // between them, the root along lines. One more knot than the time needs must follow.
    bool cubic = false;
};

// The pose at a time; constant before the first knot and after the last.
std::vector<Vec3d> pose_at(const History& history, double time);
// Filtered CVs at `time`; omega of every CV in 1/s.
std::vector<Vec3d> filtered_pose(const History& history, const std::vector<double>& omega, double zeta,
                                 double time);
// `bent`: the target at the same time. Its root is the true root; its directions replace vanishing ones.
std::vector<Vec3d> restored_lengths(const std::vector<Vec3d>& filtered, const std::vector<Vec3d>& bent,
                                    const std::vector<double>& rest_lengths);

} // namespace marram::oracle
