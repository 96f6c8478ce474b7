// SPDX-License-Identifier: Apache-2.0
// A literal implementation of the talk's method, the baseline for the chain: each CV traces one ray upwind,
// each segment rotates all points after it one at a time (O(n^2)), and collision takes fixed steps with one
// ray per test. Floats; strands in parallel; no optimisation but the compiler's.
#pragma once

#include "core/math/vec.h"
#include "procedural/wind/colliders.h"
#include "procedural/wind/gusts.h"
#include "procedural/wind/wind.h"

#include <vector>

namespace marram::bench {

struct LiteralStrands { // the CVs of a strand are contiguous
    int cvs = 0;
    std::vector<Vec3f> rest, pose;

    size_t count() const { return rest.size() / size_t(cvs); }
};

// rest -> pose, with the gusts of `field`, shielding, noise and `collision.rotation_steps` steps.
void blow_literally(const Wind& wind, const GustField& field, const Colliders& colliders,
                    LiteralStrands& strands);

} // namespace marram::bench
