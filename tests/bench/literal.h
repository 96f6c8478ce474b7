// SPDX-License-Identifier: Apache-2.0
// A literal implementation of the talk's method, the baseline for the chain: each CV traces one ray upwind,
// each segment rotates all points after it one at a time (O(n^2)), and collision takes fixed steps with one
// ray per test. Floats; strands in parallel; no optimisation but the compiler's.
#pragma once

#include "core/math/vec.h"
#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/gusts.h"
#include "procedural/wind/wind.h"

#include <vector>

namespace marram::bench {

struct LiteralStrands { // the CVs of a strand are contiguous
    int cvs = 0;
    std::vector<Vec3f> rest, pose;
    std::vector<Vec3f> target, swung,
        velocity; // of a simulation of jiggle, at its last frame; empty: none yet

    size_t count() const { return rest.size() / size_t(cvs); }
};

// rest -> pose, with the gusts of `field`, shielding, noise and `collision.rotation_steps` steps.
void blow_literally(const Wind& wind, const GustField& field, const Colliders& colliders,
                    LiteralStrands& strands);

// Jiggle as a simulation: bends the strands in the gusts of a frame, and moves the spring of each CV on to
// it from the frame before, by as many steps of semi-implicit Euler as keep the stiffest below half a
// radian. `shelter`: [strand], as shelter_literally() finds it. If `shown`, collides from rest towards the
// swung strand, its lengths restored.
std::vector<float> shelter_literally(const Wind& wind, const Colliders& colliders,
                                     const LiteralStrands& strands);
void simulate_literally(const Wind& wind, double fps, const GustField& field, const Colliders& colliders,
                        const std::vector<float>& shelter, bool shown, LiteralStrands& strands);

} // namespace marram::bench
