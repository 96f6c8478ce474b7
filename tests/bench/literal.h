// SPDX-License-Identifier: Apache-2.0
// The talk's method as its words say it, the baseline that the chain is measured against: every CV looks upwind with one ray,
// every segment turns all that follows it, one point at a time (O(n^2)), collision walks fixed steps with one ray a test. In
// floats, strands in parallel, optimised by the compiler; nothing clever.
#pragma once

#include "core/math/vec.h"
#include "procedural/wind/colliders.h"
#include "procedural/wind/gusts.h"
#include "procedural/wind/wind.h"

#include <vector>

namespace marram::bench {

struct LiteralStrands { // CVs of one strand follow each other
    int cvs = 0;
    std::vector<Vec3f> rest, pose;

    size_t count() const { return rest.size() / size_t(cvs); }
};

// rest -> pose, with the wind's gusts (those of `field`), shielding, noise and `collision.rotation_steps` steps.
void blow_literally(const Wind& wind, const GustField& field, const Colliders& colliders,
                    LiteralStrands& strands);

} // namespace marram::bench
