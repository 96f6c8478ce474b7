// SPDX-License-Identifier: Apache-2.0
// The places of the dunes of a mass desert and their ids. The arrangements are described in mass_places.cpp.
#pragma once

#include "core/math/hash.h"
#include "procedural/terrain/mass/mass_desert.h"

#include <string>
#include <vector>

namespace marram {

// A place for a dune. `at`: x and z, metres.
struct MassPlace {
    uint64_t id;
    Vec2d at;
    double angle; // downwind
};

// A rectangle, x and z in metres, without its upper sides.
struct MassArea {
    Vec2d lower, upper;
    bool has(const Vec2d& p) const {
        return (p.array() >= lower.array()).all() && (p.array() < upper.array()).all();
    }
};

// Seed of the random numbers of all places and dunes; those of one dune have the seed hash(this, id).
inline uint64_t mass_seed(const MassSettings& settings) {
    return hash(settings.seed, uint64_t(settings.arrangement) + 0x6d617373);
}

// All places in the area that have a dune, before edits, sorted by id. None if the area is empty or reaches
// beyond 10^9 m. The settings must be within their ranges. Throws SceneFault if mass_count() is above
// max_mass_dunes.
std::vector<MassPlace> mass_places(const MassSettings& settings, const MassArea& area);

// An approximate upper bound of the number of places in the area.
double mass_count(const MassSettings& s, const MassArea& area);

// Throws the SceneFault for `about` that many dunes. `place`: of the parameter, as in MarramMessage.
void mass_too_many(double about, const std::string& place = "");

} // namespace marram
